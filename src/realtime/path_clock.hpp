#pragma once

#include <algorithm>

#include "realtime/slow.hpp"

namespace realtime {

// The time along a trajectory. It goes as the robot's clock does, or at a lesser rate r while something wants it slower, to which it
// changes smoothly: r'' = w² (wanted - r) - 2 w r'.
class PathClock {
 public:
  // At the full rate.
  void start(double time) noexcept {
    time_ = time;
    rate_ = 1;
    change_ = 0;
  }

  void step(double wanted_rate, double dt) noexcept {
    change_ += dt * (kQuickness * kQuickness * (wanted_rate - rate_) - 2 * kQuickness * change_);
    rate_ += dt * change_;
    if (rate_ <= 0 || rate_ >= 1) {
      rate_ = std::clamp(rate_, 0., 1.);
      change_ = 0;
    }
    time_ += dt * rate_;
  }

  double time() const noexcept { return time_; }  // s
  double rate() const noexcept { return rate_; }

  // Derivatives by the time of the path become those by the robot's.
  void slow(Reference& reference) const noexcept { realtime::slow(reference, rate_, change_); }

 private:
  static constexpr double kQuickness = 30;  // 1/s

  double time_ = 0, rate_ = 1, change_ = 0;
};

}  // namespace realtime
