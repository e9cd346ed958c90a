#pragma once

#include "wire/fci/service.hpp"

namespace robot {

// Thresholds of external torques of the joints and of the wrench at the stiffness frame, N m; N, N m: the robot calls it contact
// above the lower ones, and stops with a reflex above the upper ones. Those that franka-interface has been published with, which
// leave all of the joints' range of torque to skills that press: a robot is switched on with 20 N and 20 N m for everything.
inline constexpr fci::SetCollisionBehavior kCollisionBehavior = [] {
  constexpr fci::Vector7 lower_torque = {20, 20, 18, 18, 16, 14, 12}, upper_torque = {120, 120, 118, 118, 116, 114, 112};
  constexpr fci::Vector6 lower_force = {20, 20, 20, 25, 25, 25}, upper_force = {120, 120, 120, 125, 125, 125};
  return fci::SetCollisionBehavior{lower_torque, upper_torque, lower_torque, upper_torque,
                                   lower_force,  upper_force,  lower_force,  upper_force};
}();

}  // namespace robot
