#pragma once

#include "wire/fci/service.hpp"

namespace testing_tools {

// The same for contacts and collisions, accelerating or not; N m and N.
inline fci::SetCollisionBehavior thresholds(double torque, double force) {
  fci::SetCollisionBehavior behavior;
  behavior.lower_torque_thresholds_acceleration.fill(torque);
  behavior.upper_torque_thresholds_acceleration = behavior.lower_torque_thresholds_nominal =
      behavior.upper_torque_thresholds_nominal = behavior.lower_torque_thresholds_acceleration;
  behavior.lower_force_thresholds_acceleration.fill(force);
  behavior.upper_force_thresholds_acceleration = behavior.lower_force_thresholds_nominal =
      behavior.upper_force_thresholds_nominal = behavior.lower_force_thresholds_acceleration;
  return behavior;
}

}  // namespace testing_tools
