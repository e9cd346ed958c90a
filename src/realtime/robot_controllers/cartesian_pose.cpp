#include "realtime/robot_controllers/cartesian_pose.hpp"

#include "realtime/rotation.hpp"
#include "realtime/tool.hpp"

namespace realtime::robot_controllers {
namespace {

// By which poses differ that are the same.
constexpr double kSamePosition = 2e-3;  // m
constexpr double kSameAngle = 0.01;     // rad

bool same(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b, double position, double angle) {
  const Vector6 change = change_between(at(a), at(b));
  return change.head<3>().norm() < position && change.tail<3>().norm() < angle;
}

}  // namespace

Reference CartesianPose::start(const Cycle& cycle, Channels, Model& model) const noexcept {
  // From where the robot says that it is: its kinematics may be calibrated, and are not ours.
  const Vector7 q_d = Vector7::Map(cycle.state.q_d.data());
  const Eigen::Isometry3d of_joints = model.O_T_EE(q_d);
  Eigen::Isometry3d T = cycle.O_T_EE * model.O_T_EE(cycle.q).inverse() * of_joints;
  if (is_pose(cycle.state.O_T_EE_c)) {
    const Eigen::Isometry3d commanded = pose(cycle.state.O_T_EE_c);
    if (same(T, commanded, kSamePosition, kSameAngle)) T = commanded;
  }
  // Next to a singular posture the joints of a pose that was rounded are far from those that were: there they count.
  if (same(T, of_joints, kFloatRounding, kFloatRounding)) T = of_joints;
  Reference reference;
  reference.motion = Channels::kPose;
  reference.cartesian.position = T.translation();
  reference.cartesian.orientation = Eigen::Quaterniond(T.linear()).normalized();
  return reference;
}

void CartesianPose::write(const Reference&, const Reference& reference, const Vector7&,
                          fci::RobotCommand& command) const noexcept {
  Eigen::Matrix4d::Map(command.O_T_EE_c.data()) = frame(reference.cartesian).matrix();
}

}  // namespace realtime::robot_controllers
