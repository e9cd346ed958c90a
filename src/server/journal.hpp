#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>

namespace server {

// What an arm's process was told and said beside the states of its arm, the newest first kept: sensor messages, skills, lines of
// its log. It may lie in memory that outlives the process.
class Journal {
 public:
  struct Entry {
    std::int64_t time_ns = 0;  // CLOCK_MONOTONIC, when it was noted
    std::int64_t sent_ns = 0;  // since 1970 by the server's clock, as estimated; 0: not known
    std::uint32_t sequence = 0;
    std::string topic;
    std::string type;  // full name of the protobuf message
    std::string bytes;
  };

  // In memory of size() bytes that stays as long as this; what was there is overwritten.
  explicit Journal(std::shared_ptr<void> memory);
  // The one that lies there already.
  static Journal found(std::shared_ptr<void> memory);

  static constexpr std::size_t size() { return sizeof(Header) + kBytes; }

  // From any thread. An entry that is longer than the journal is not noted.
  void note(std::string_view topic, std::string_view type, std::string_view bytes, std::uint32_t sequence = 0,
            std::int64_t sent_ns = 0);

  // A place in it, of what is noted next or of the oldest that there is.
  std::uint64_t end() const;
  std::uint64_t begin() const;
  // The entry at a place, which is moved on to the next; false when there is none yet. A place that was overwritten is moved to
  // the oldest, and one at which no entry can be to the end; `lost` grows by the bytes between.
  bool read(std::uint64_t& place, Entry& entry, std::uint64_t& lost) const;

 private:
  static constexpr std::size_t kBytes = 4 << 20;
  struct Header {
    std::atomic<std::uint64_t> begin{0}, end{0};  // bytes since the first
  };

  Journal(std::shared_ptr<void> memory, int);
  void put(std::uint64_t place, const void* from, std::size_t size);
  void get(std::uint64_t place, void* to, std::size_t size) const;

  std::shared_ptr<void> memory_;
  Header* header_;
  char* bytes_;
  std::unique_ptr<std::mutex> mutex_;  // of this process's threads
};

}  // namespace server
