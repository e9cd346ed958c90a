#pragma once

#include "realtime/reference.hpp"
#include "wire/fci/robot_state.hpp"

namespace realtime {

// Of the world at the robot's base, axes of O, m/s²; upright where the robot does not say how it stands.
inline Vector3 base_gravity(const fci::RobotState& state) noexcept {
  const Vector3 reported = Vector3::Map(state.O_ddP_O.data());
  return reported.isZero() ? Vector3(0, 0, -9.81) : reported;
}

}  // namespace realtime
