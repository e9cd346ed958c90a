#pragma once

#include <algorithm>

#include "realtime/slow.hpp"
#include "realtime/tick.hpp"

namespace realtime {

// The time along a trajectory. It goes at a speed by the robot's clock, or at a lesser rate r while something wants it slower, to
// which it changes smoothly: r'' = w² (wanted - r) - 2 w r'.
class PathClock {
 public:
  // At 0 s, with that speed: > 0, at most 1.
  void start(double speed) noexcept {
    speed_ = rate_ = speed;
    time_ = change_ = 0;
  }

  // Back by a cycle, to before the start.
  void step_back() noexcept { time_ -= kTick * rate_; }

  // dt s on, on the way to that share of its speed.
  void step(double wanted_share, double dt) noexcept {
    change_ += dt * (kQuickness * kQuickness * (wanted_share * speed_ - rate_) - 2 * kQuickness * change_);
    rate_ += dt * change_;
    if (rate_ <= 0 || rate_ >= speed_) {
      rate_ = std::clamp(rate_, 0., speed_);
      change_ = 0;
    }
    time_ += dt * rate_;
  }

  double time() const noexcept { return time_; }  // s
  double share() const noexcept { return rate_ / speed_; }  // of its speed

  // The robot's time that so much of a trajectory's takes when nothing wants it slower, s.
  double lasts(double time) const noexcept { return time / speed_; }

  // Derivatives by the time of the path become those by the robot's.
  void slow(Reference& reference) const noexcept { realtime::slow(reference, rate_, change_); }

 private:
  static constexpr double kQuickness = 30;  // 1/s

  double time_ = 0, speed_ = 1, rate_ = 1, change_ = 0;
};

}  // namespace realtime
