#include "realtime/robot_controllers/joint_position.hpp"

namespace realtime::robot_controllers {

Reference JointPosition::start(const Cycle& cycle, Channels, Model&) const noexcept {
  Reference reference;
  reference.motion = Channels::kJoint;
  reference.joint.q = Vector7::Map(cycle.state.q_d.data());
  return reference;
}

void JointPosition::write(const Reference&, const Reference& reference, const Vector7&,
                          fci::RobotCommand& command) const noexcept {
  Vector7::Map(command.q_c.data()) = reference.joint.q;
}

}  // namespace realtime::robot_controllers
