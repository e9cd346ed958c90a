#pragma once

#include <algorithm>

#include "realtime/cholesky.hpp"
#include "realtime/reference.hpp"

namespace realtime {

// What the end effector weighs in a direction, kg or kg m²: 1 / (J_i M^-1 J_i^T); `torque`: J_i^T, of one newton (meter) along it.
inline double inertia_along(const Cholesky<7>& M, const Vector7& torque) noexcept {
  constexpr double kLeastMobility = 1e-3;  // 1/kg, 1/(kg m²): next to a singularity it weighs no more than this
  return 1 / std::max(torque.dot(M.solve(torque)), kLeastMobility);
}

}  // namespace realtime
