#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

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

// Whose a black box is: what is left of it is written there.
struct BlackBoxOwner {
  std::string arm;
  std::string folder;  // of recordings
  double max_gb = 0;   // of them
};

// Memory for one that a child may inherit. With an owner it outlives all of its processes where it can: it has a name in
// black_box_folder(), until forget_black_box(), and whoever holds it open keeps others from taking it for left over. Throws
// std::system_error.
int make_black_box_file(const std::optional<BlackBoxOwner>& owner = {});

// Takes its name away: what is in it is written down, or not needed.
void forget_black_box(int fd);

// Leaves what is in it for the next start, where it has a name and there are not too many; returns what is to be told of that.
std::string leave_black_box(int fd);

// Black boxes of this user that nobody holds, the processes being gone that did. Each is the caller's now, until it closes the
// file. What another build of this program left cannot be read, and is removed.
struct LeftBlackBox {
  int fd;
  BlackBoxOwner owner;
};
std::vector<LeftBlackBox> left_black_boxes();

// Of memory that a file can name, gone with the computer's power: $FRANKA_INTERFACE_BLACK_BOXES, or /dev/shm.
std::string black_box_folder();

}  // namespace server
