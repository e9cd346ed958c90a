#pragma once

#include "realtime/check.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// Stays at the reference of its start for a while, joints or pose.
class Stay : public TrajectoryGenerator {
 public:
  // Duration in s, >= 0. Throws std::invalid_argument naming field, value and bound.
  Stay(Channels motion, double duration) : motion_(motion), duration_(duration) {
    require_within("duration", -1, duration, 0, 1e6, "s");
  }

  Channels fills() const noexcept override { return motion_; }
  void start(const Reference& from) noexcept override { goal_ = at_rest(from); }
  bool step(const Cycle&, double time, Reference& reference) noexcept override {
    reference = goal_;
    return time >= duration_;
  }
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return duration_; }
  double stretch() const noexcept override { return 1; }

 private:
  Channels motion_;
  double duration_;
  Reference goal_;
};

}  // namespace realtime
