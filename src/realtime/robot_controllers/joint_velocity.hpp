#pragma once

#include "realtime/robot_controllers/joint_position.hpp"

namespace realtime::robot_controllers {

// Joint velocities (dq_c): those that lead to the reference within the cycle, so that what the robot integrates stays on it.
class JointVelocity : public JointPosition {
 public:
  void write(const Reference& before, const Reference& reference, const Vector7&,
             fci::RobotCommand& command) const noexcept override {
    Vector7::Map(command.dq_c.data()) = (reference.joint.q - before.joint.q) / kTick;
  }
};

}  // namespace realtime::robot_controllers
