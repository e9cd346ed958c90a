#pragma once

#include "realtime/robot_controllers/cartesian_pose.hpp"
#include "realtime/rotation.hpp"

namespace realtime::robot_controllers {

// Twists of EE in the axes of O (O_dP_EE_c): those that lead to the reference within the cycle.
class CartesianVelocity : public CartesianPose {
 public:
  void write(const Reference& before, const Reference& reference, const Vector7&,
             fci::RobotCommand& command) const noexcept override {
    Vector6::Map(command.O_dP_EE_c.data()) = change_between(before.cartesian, reference.cartesian) / kTick;
  }
};

}  // namespace realtime::robot_controllers
