#include "sim/pace.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace sim {
namespace {

constexpr std::int64_t kCycle = 1'000'000;  // ns
constexpr std::int64_t kMakeUp = 4;         // cycles that make up for one
// ns by which what is usual grows in a cycle that takes longer, and becomes less in another: so one in twenty takes longer.
constexpr std::int64_t kLonger = 950, kShorter = 50;
constexpr std::int64_t kMostSteady = 20;    // part of a period that is waited for at most, as another arm may have use for it
constexpr std::int64_t kMostBehind = 100;   // cycles; a computer that is too slow never makes up for them

}  // namespace

Pace::Pace(Clock& clock, double speed)
    : clock_(clock),
      period_(std::llround(kCycle / speed)),
      tolerance_(period_ / 5),
      deadline_(clock.now()),
      done_(deadline_) {}

bool Pace::wait() {
  const std::int64_t sooner = std::min(behind_, period_ / kMakeUp);
  behind_ -= sooner;
  deadline_ += period_ - sooner;
  clock_.sleep_until(deadline_);
  return clock_.now() - deadline_ > tolerance_;
}

void Pace::wait_until(std::int64_t time) {
  if (time < next()) clock_.sleep_until(time);
}

void Pace::steady() {
  const std::int64_t took = clock_.now() - deadline_;
  if (took > tolerance_) return;
  usual_ = std::clamp<std::int64_t>(usual_ + (took > usual_ ? kLonger : -kShorter), 0, period_ / kMostSteady);
  while (clock_.now() < deadline_ + usual_) {  // less than a thread can sleep
  }
}

void Pace::done() {
  done_ = clock_.now() - std::exchange(in_vain_, 0);
  const std::int64_t delay = done_ - deadline_;
  if (delay <= tolerance_) return;
  ++late_;
  worst_ = std::max(worst_, delay);
  if (delay < period_) return;
  deadline_ = done_;
  behind_ = std::min(behind_ + delay, kMostBehind * period_);
}

}  // namespace sim
