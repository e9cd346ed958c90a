#pragma once

#include "realtime/robot_controllers/motion.hpp"

namespace realtime::robot_controllers {

// Joint positions (q_c).
class JointPosition : public Motion {
 public:
  Reference start(const Cycle& cycle, Channels motion, Model& model) const noexcept override;
  void write(const Reference& before, const Reference& reference, const Vector7& tau_J_d,
             fci::RobotCommand& command) const noexcept override;
};

}  // namespace realtime::robot_controllers
