#pragma once

#include "realtime/robot_controllers/motion.hpp"

namespace realtime::robot_controllers {

// Poses of EE (O_T_EE_c).
class CartesianPose : public Motion {
 public:
  bool makes_joints() const noexcept override { return true; }
  // O_T_EE_c, if it is where q_d has the tool by the robot's own kinematics; else that, since a robot may keep the last pose of a former motion.
  Reference start(const Cycle& cycle, Channels motion, Model& model) const noexcept override;
  void write(const Reference& before, const Reference& reference, const Vector7& tau_J_d,
             fci::RobotCommand& command) const noexcept override;
};

}  // namespace realtime::robot_controllers
