#pragma once

#include "realtime/cycle.hpp"
#include "realtime/tool.hpp"

namespace realtime {

// What EE exerts on its surroundings, as the robot estimates it (O_F_ext_hat_K), moved from K to EE; axes of O, N and N m.
// Zero where it is not finite.
inline Vector6 felt_wrench(const Cycle& cycle) noexcept {
  Vector6 felt = Vector6::Map(cycle.state.O_F_ext_hat_K.data());
  const Vector3 EE_x_K = pose(cycle.state.EE_T_K).translation();
  felt.tail<3>() += (cycle.O_T_EE.linear() * EE_x_K).cross(felt.head<3>());
  if (!felt.allFinite()) felt.setZero();
  return felt;
}

}  // namespace realtime
