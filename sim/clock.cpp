#include "sim/clock.hpp"

#include <poll.h>
#include <sched.h>
#include <sys/prctl.h>

#include <algorithm>
#include <ctime>

namespace sim {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;  // ns

bool readable(int socket, std::int64_t timeout) {
  pollfd wanted{socket, POLLIN, 0};
  const timespec time{timeout / kSecond, timeout % kSecond};
  return ::ppoll(&wanted, 1, &time, nullptr) != 0;
}

}  // namespace

std::int64_t WallClock::now() const {
  timespec time;
  ::clock_gettime(CLOCK_MONOTONIC, &time);
  return time.tv_sec * kSecond + time.tv_nsec;
}

void WallClock::sleep_until(std::int64_t time) {
  thread_local const bool sharp = ::prctl(PR_SET_TIMERSLACK, 1) == 0;  // ns; 50 µs unless told
  static_cast<void>(sharp);
  const timespec until{time / kSecond, time % kSecond};
  ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
}

void WallClock::wait_for(int socket, std::int64_t time) {
  // Who is in a hurry answers sooner than a sleeping thread wakes; that one may be waiting for this processor.
  constexpr std::int64_t kPolling = 25'000;  // ns, as most answers take
  const std::int64_t begin = now();
  for (std::int64_t until = std::min(time, begin + kPolling); now() < until;) {
    if (readable(socket, 0)) return;
    ::sched_yield();
  }
  if (const std::int64_t left = time - now(); left > 0) readable(socket, left);
}

}  // namespace sim
