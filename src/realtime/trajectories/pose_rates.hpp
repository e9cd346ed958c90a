#pragma once

#include <array>
#include <cmath>

#include "models/arm.hpp"
#include "realtime/check.hpp"
#include "realtime/trajectories/min_jerk.hpp"

namespace realtime {

// Of each axis of translation and rotation a share of the arm's Cartesian limits that keeps their norms. Throws
// std::invalid_argument unless `speed` is 0.01 to 1.
inline std::array<models::Limits::Rates, 6> pose_rates(const models::Limits& limits, double speed) {
  require_within("speed", -1, speed, 0.01, 1, "of the limits");
  const double share = kMotionShare * speed / std::sqrt(3.0);
  std::array<models::Limits::Rates, 6> rates;
  for (int i = 0; i < 6; ++i) {
    const models::Limits::Rates& most = i < 3 ? limits.translation : limits.rotation;
    rates[i] = {share * most.velocity, share * most.acceleration, share * most.jerk};
  }
  return rates;
}

}  // namespace realtime
