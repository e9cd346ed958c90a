#pragma once

#include "realtime/trajectories/pose_difference.hpp"
#include "realtime/trajectories/timed_pose.hpp"

namespace realtime {

// With constant velocity to the pose of the reference at the start changed by a difference.
class RelativeLinearPose : public TimedPose {
 public:
  // Duration in s, > 0. Throws std::invalid_argument naming field, value and bound.
  RelativeLinearPose(const PoseDifference& difference, double duration, const models::Limits& limits)
      : TimedPose(TimeLaw::kLinear, duration, limits), difference_(difference) {}

  void start(const Reference& from) noexcept override {
    difference_.apply(from.cartesian, goal_.cartesian);
    TimedPose::start(from);
  }

 private:
  PoseDifference difference_;
};

}  // namespace realtime
