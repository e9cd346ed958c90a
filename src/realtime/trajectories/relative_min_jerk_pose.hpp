#pragma once

#include "realtime/trajectories/min_jerk_pose.hpp"
#include "realtime/trajectories/pose_difference.hpp"

namespace realtime {

// As MinJerkPose, to the pose of the reference at the start changed by a difference.
class RelativeMinJerkPose : public MinJerkPose {
 public:
  // Duration in s, > 0. Throws std::invalid_argument naming field, value and bound.
  RelativeMinJerkPose(const PoseDifference& difference, double duration, const models::Limits& limits)
      : MinJerkPose(duration, limits), difference_(difference) {}

  void start(const Reference& from) noexcept override {
    difference_.apply(from.cartesian, goal_.cartesian);
    MinJerkPose::start(from);
  }

 private:
  PoseDifference difference_;
};

}  // namespace realtime
