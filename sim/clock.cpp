#include "sim/clock.hpp"

#include <sys/prctl.h>

#include <algorithm>
#include <cmath>

namespace sim {
namespace {

constexpr std::int64_t kCycle = 1'000'000;      // ns
constexpr std::int64_t kSecond = 1'000'000'000;  // ns
constexpr std::int64_t kMakeUp = 4;              // cycles that make up for one
constexpr std::int64_t kMostBehind = 100;        // cycles; a computer that is too slow never makes up for them

void sleep_until(std::int64_t time) {
  const timespec until{time / kSecond, time % kSecond};
  ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
}

}  // namespace

Clock::Clock(double speed)
    : period_(std::llround(kCycle / speed)), tolerance_(period_ / 5), deadline_(now()), done_(deadline_) {
  ::prctl(PR_SET_TIMERSLACK, 1);  // ns; 50 µs unless told
}

std::int64_t Clock::now() {
  timespec time;
  ::clock_gettime(CLOCK_MONOTONIC, &time);
  return time.tv_sec * kSecond + time.tv_nsec;
}

bool Clock::wait() {
  const std::int64_t sooner = std::min(behind_, period_ / kMakeUp);
  behind_ -= sooner;
  deadline_ += period_ - sooner;
  sleep_until(deadline_);
  return now() - deadline_ > tolerance_;
}

void Clock::wait_until(std::int64_t time) const {
  if (time < next()) sleep_until(time);
}

void Clock::done() {
  done_ = now();
  const std::int64_t delay = done_ - deadline_;
  if (delay <= tolerance_) return;
  ++late_;
  worst_ = std::max(worst_, delay);
  if (delay < period_) return;
  deadline_ = done_;
  behind_ = std::min(behind_ + delay, kMostBehind * period_);
}

}  // namespace sim
