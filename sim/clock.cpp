#include "sim/clock.hpp"

#include <sys/prctl.h>

#include <algorithm>

namespace sim {
namespace {

constexpr std::int64_t kCycle = 1'000'000;      // ns
constexpr std::int64_t kSecond = 1'000'000'000;  // ns

}  // namespace

Clock::Clock() : deadline_(now()) {
  ::prctl(PR_SET_TIMERSLACK, 1);  // ns; 50 µs unless told
}

std::int64_t Clock::now() {
  timespec time;
  ::clock_gettime(CLOCK_MONOTONIC, &time);
  return time.tv_sec * kSecond + time.tv_nsec;
}

bool Clock::wait() {
  deadline_ += kCycle;
  const timespec until{deadline_ / kSecond, deadline_ % kSecond};
  ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
  return now() - deadline_ > kTolerance;
}

void Clock::done() {
  const std::int64_t time = now();
  const std::int64_t delay = time - deadline_;
  if (delay <= kTolerance) return;
  ++late_;
  worst_ = std::max(worst_, delay);
  deadline_ = time;
}

}  // namespace sim
