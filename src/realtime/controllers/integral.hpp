#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "realtime/cycle.hpp"

namespace realtime {

// One cycle of the sum of r K e dt (N or N m, each at most its limit) that takes away what friction leaves of a spring's way e. `rate`,
// r, is held to a quarter of the least damping of the spring's modes (1/s): with it a mode of damping d is stable if and only if
// r < d (Routh). While another torque leaves than was `asked` for in the cycle before, the sum does not grow.
template <int N>
void integrate(const Cycle& cycle, const Vector7& asked, const Eigen::Matrix<double, N, 1>& spring, double rate, double least_damping,
               const Eigen::Matrix<double, N, 1>& limit, Eigen::Matrix<double, N, 1>& sum) noexcept {
  constexpr double kShare = 0.25, kAsAsked = 1e-6;  // kAsAsked: N m
  const bool held_back = (cycle.tau_J_d - asked).cwiseAbs().maxCoeff() > kAsAsked;
  const double step = std::min(rate, kShare * least_damping) * cycle.dt;
  for (int i = 0; i < N; ++i) {
    const double next = std::clamp(sum[i] + step * spring[i], -limit[i], limit[i]);
    if (!held_back || std::abs(next) < std::abs(sum[i])) sum[i] = next;
  }
}

}  // namespace realtime
