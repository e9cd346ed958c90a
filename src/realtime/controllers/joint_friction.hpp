#pragma once

#include <cmath>

#include "models/joint_figures.hpp"
#include "realtime/reference.hpp"

namespace realtime {

// The torque (N m) that joints need against their friction to move at dq (rad/s): sticking and sliding as in
// models/joint_figures.hpp, with a step at rest that is smooth. For velocities of a reference: what is measured would make the
// arm push itself on, while a reference rests where it is and says nothing of who pushes the arm.
inline Vector7 against_friction(const Vector7& dq) noexcept {
  constexpr double kSmooth = 0.01;  // rad/s
  Vector7 tau;
  for (int i = 0; i < models::kJoints; ++i) {
    const double sticking = models::kStickingShare * models::kFrictionHeight[i];
    tau[i] = sticking * std::tanh(dq[i] / kSmooth) +
             (models::kFrictionHeight[i] / 2 - sticking) * std::tanh(models::kFrictionRise[i] * dq[i] / 2);
  }
  return tau;
}

}  // namespace realtime
