#include "realtime/trajectories/relative_min_jerk_pose.hpp"

#include "realtime/check.hpp"

namespace realtime {

RelativeMinJerkPose::RelativeMinJerkPose(const Parameters& parameters, const models::Limits& limits)
    : MinJerkPose(parameters.duration, limits),
      translation_by_(parameters.translation),
      rotation_by_(require_rotation("quaternion", parameters.rotation)),
      frame_(parameters.frame) {
  for (int i = 0; i < 3; ++i) require_within("translation", i, translation_by_[i], -2, 2, "m");
}

void RelativeMinJerkPose::start(const Reference& from) noexcept {
  const CartesianReference& pose = from.cartesian;
  const Vector3 by = frame_ == Frame::kEndEffector ? Vector3(pose.orientation * translation_by_) : translation_by_;
  goal_.cartesian.position = pose.position + by;
  goal_.cartesian.orientation = (pose.orientation * rotation_by_).normalized();
  MinJerkPose::start(from);
}

}  // namespace realtime
