#pragma once

#include <cstdint>
#include <ctime>

namespace server {

inline std::int64_t clock_ns(clockid_t clock) {
  timespec time;
  ::clock_gettime(clock, &time);
  return time.tv_sec * 1'000'000'000ll + time.tv_nsec;
}

// CLOCK_MONOTONIC, as the loop has its times.
inline std::int64_t now_ns() { return clock_ns(CLOCK_MONOTONIC); }

// A time of now_ns() in nanoseconds since 1970. The clock may be set while the process runs: the difference stays what it was
// when first asked for, so that times keep their distances.
inline std::int64_t since_epoch_ns(std::int64_t monotonic) {
  static const std::int64_t difference = clock_ns(CLOCK_REALTIME) - now_ns();
  return monotonic + difference;
}

}  // namespace server
