#include "sim/robot/arm_capsules.hpp"

#include <Eigen/Geometry>
#include <algorithm>

#include "sim/robot/rotation.hpp"

namespace sim {

using Eigen::Vector3d;

ArmCapsules::ArmCapsules(const models::Arm& arm) {
  constexpr int kHand = 8;  // models::Capsule::link
  const auto& [xyz, rpy] = arm.joints[7];
  const Eigen::Isometry3d flange =
      Eigen::Translation3d(xyz[0], xyz[1], xyz[2]) * Eigen::Isometry3d(rotation_of_rpy(rpy));
  const Eigen::Isometry3d hand = flange * Eigen::AngleAxisd(models::hand::kYaw, Vector3d::UnitZ());
  for (const models::Capsule& capsule : models::capsules()) {
    const Eigen::Isometry3d in_link = capsule.link == kHand ? hand : Eigen::Isometry3d::Identity();
    const Vector3d centre(capsule.centre[0], capsule.centre[1], capsule.centre[2]);
    const Vector3d half = capsule.length / 2 * Vector3d::Unit(capsule.axis - 'x');
    capsules_.push_back({.link = capsule.link,
                         .centre = in_link * centre,
                         .half = in_link.linear() * half,
                         .radius = capsule.radius,
                         .reach = capsule.radius + capsule.length / 2});
  }
}

ArmCapsules::Axes ArmCapsules::place(const ArmModel& at) const {
  Axes axes;
  for (std::size_t i = 0; i < capsules_.size(); ++i) {
    const Capsule& capsule = capsules_[i];
    if (capsule.link == 0) {
      axes.centre[i] = capsule.centre;
      axes.half[i] = capsule.half;
    } else {
      const int joint = std::min(capsule.link, 7);
      axes.centre[i].noalias() = at.O_p(joint) + at.O_R(joint) * capsule.centre;
      axes.half[i].noalias() = at.O_R(joint) * capsule.half;
    }
  }
  return axes;
}

}  // namespace sim
