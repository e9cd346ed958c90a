#pragma once

#include "server/arm_at_home.hpp"

// A cycle of an arm at home, for trajectories that do not look at it.
inline const realtime::Cycle& at_home() {
  static const server::ArmAtHome arm;
  return arm.cycle;
}
