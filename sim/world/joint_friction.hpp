#pragma once

#include <cmath>

namespace sim {

// Friction that holds a joint at rest, and rises with speed to a bound:
//   tau = sigma_0 z + sigma_1 dz/dt + rising tanh(rise dq / 2),  dz/dt = dq - sigma_0 |dq| z / sticking
// A bristle of stiffness sigma_0 bends by z, less than a tenth of a millirad, until it carries `sticking` (Canudas de Wit,
// Olsson, Åström, Lischinsky, A new model for control of systems with friction, IEEE Trans. Automatic Control 40(3),
// 1995, without Stribeck effect). By default none.
class JointFriction {
 public:
  double sticking = 0;  // N m
  double rising = 0;    // N m, beyond sticking at high speed
  double rise = 0;      // s/rad

  // Torque against the motion dq (rad/s) over the next dt (s). Implicit in z, so that the bristle never exceeds its bound.
  double step(double dq, double dt) {
    if (sticking == 0) return 0;
    const double before = z_;
    z_ = (z_ + dt * dq) / (1 + dt * std::abs(dq) * kSigma0 / sticking);
    return kSigma0 * z_ + kSigma1 * (z_ - before) / dt + rising * std::tanh(rise * dq / 2);
  }

 private:
  static constexpr double kSigma0 = 4000;  // N m/rad
  static constexpr double kSigma1 = 12;    // N m s/rad
  double z_ = 0;                           // rad
};

}  // namespace sim
