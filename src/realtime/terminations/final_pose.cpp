#include "realtime/terminations/final_pose.hpp"

#include "realtime/check.hpp"
#include "realtime/rotation.hpp"

namespace realtime {

FinalPose::FinalPose(const Parameters& parameters)
    : position_threshold_(parameters.position_threshold), orientation_threshold_(parameters.orientation_threshold) {
  for (int i = 0; i < 3; ++i) require_within("position_threshold", i, position_threshold_[i], 0, 2, "m");
  require_within("orientation_threshold", -1, orientation_threshold_, 0, 3.2, "rad");
}

bool FinalPose::step(const Cycle& cycle, const Progress& progress) noexcept {
  const CartesianReference& goal = progress.trajectory.goal().cartesian;
  const Vector3 way = goal.position - cycle.O_T_EE.translation();
  const Eigen::Quaterniond orientation(cycle.O_T_EE.linear());
  return (way.cwiseAbs().array() <= position_threshold_.array()).all() &&
         log(goal.orientation * orientation.conjugate()).norm() <= orientation_threshold_;
}

}  // namespace realtime
