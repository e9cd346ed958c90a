#pragma once

#include <array>

#include "models/arm.hpp"
#include "realtime/check.hpp"
#include "realtime/trajectories/min_jerk.hpp"

namespace realtime {

// Of each joint a share of the arm's limits. Throws std::invalid_argument unless `speed` is 0.01 to 1.
inline std::array<models::Limits::Rates, models::kJoints> joint_rates(const models::Limits& limits, double speed) {
  require_within("speed", -1, speed, 0.01, 1, "of the limits");
  const double share = kMotionShare * speed;
  std::array<models::Limits::Rates, models::kJoints> rates;
  for (int i = 0; i < models::kJoints; ++i) {
    rates[i] = {share * limits.dq_max[i], share * limits.ddq_max[i], share * limits.dddq_max[i]};
  }
  return rates;
}

}  // namespace realtime
