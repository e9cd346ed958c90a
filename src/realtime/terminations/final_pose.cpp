#include "realtime/terminations/final_pose.hpp"

#include "realtime/check.hpp"
#include "realtime/rotation.hpp"

namespace realtime {

FinalPose::FinalPose(const Parameters& parameters)
    : position_threshold_(parameters.position_threshold),
      orientation_threshold_(parameters.orientation_threshold),
      judged_(parameters.judged) {
  for (int i = 0; i < 3; ++i) require_within("position_threshold", i, position_threshold_[i], 0, 2, "m");
  require_within("orientation_threshold", -1, orientation_threshold_, 0, 3.2, "rad");
}

bool FinalPose::step(const Cycle& cycle, const Progress& progress) noexcept {
  const CartesianReference& goal = progress.trajectory.goal().cartesian;
  const CartesianReference now = judged_ == Judged::kArm ? at(cycle.O_T_EE) : progress.reference.cartesian;
  const Vector6 way = change_between(now, goal);
  return (way.head<3>().cwiseAbs().array() <= position_threshold_.array()).all() && way.tail<3>().norm() <= orientation_threshold_;
}

}  // namespace realtime
