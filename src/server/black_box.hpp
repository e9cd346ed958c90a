#pragma once

#include <memory>
#include <string>

#include "bridge/ring.hpp"
#include "realtime/door.hpp"
#include "server/journal.hpp"

namespace server {

// The last seconds of an arm's process, in memory that the supervisor shares, so that they can still be written to disk when the
// process has ended in the middle of something.
struct BlackBox {
  static constexpr std::size_t kKept = 10'000;             // records: 10 s
  static constexpr std::size_t kRecords = kKept + 2'500;   // and time to write them, while others come

  bridge::Ring<realtime::Record> records;
  Journal journal;

  // Empty, in memory of this process.
  BlackBox();
  // Empty, in the memory of a file as made below. Throws std::system_error.
  static BlackBox in(int fd);
  // What is left there; null when there is nothing.
  static std::unique_ptr<BlackBox> found(int fd);

 private:
  BlackBox(std::shared_ptr<void> journal_memory, std::shared_ptr<void> records_memory);
  BlackBox(bridge::Ring<realtime::Record> records, Journal journal);
};

// Memory for one that a child may inherit. Throws std::system_error.
int make_black_box_file();

}  // namespace server
