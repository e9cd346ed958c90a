#pragma once

#include <chrono>
#include <cstdint>

namespace server {

// Whether a thread lives, by a number of its own that grows.
class SignOfLife {
 public:
  using Duration = std::chrono::steady_clock::duration;

  // How long the number has been the same, at time `now`; zero while the thread has nothing to do.
  Duration silence(std::uint64_t count, bool busy, Duration now) {
    if (count != count_ || !busy) {
      count_ = count;
      heard_ = now;
    }
    return now - heard_;
  }

 private:
  std::uint64_t count_ = 0;
  Duration heard_{};
};

}  // namespace server
