#pragma once

namespace sim {

// Friction that sticks, creeps by less than a tenth of a millirad, and slides (Canudas de Wit, Olsson, Åström,
// Lischinsky, A new model for control of systems with friction, IEEE Trans. Automatic Control 40(3), 1995, without the
// Stribeck effect): a bristle of stiffness sigma_0 bends by z until it carries the Coulomb torque.
//   dz/dt = dq - sigma_0 |dq| z / coulomb,  tau = sigma_0 z + sigma_1 dz/dt + viscous dq
class JointFriction {
 public:
  double coulomb = 0;  // N m
  double viscous = 0;  // N m s/rad

  // Torque against the motion dq (rad/s) over the next dt (s). Implicit in z, so that it never exceeds what it may.
  double step(double dq, double dt) {
    if (coulomb == 0) return viscous * dq;
    const double before = z_;
    z_ = (z_ + dt * dq) / (1 + dt * (dq < 0 ? -dq : dq) * kSigma0 / coulomb);
    return kSigma0 * z_ + kSigma1 * (z_ - before) / dt + viscous * dq;
  }

 private:
  static constexpr double kSigma0 = 4000;  // N m/rad
  static constexpr double kSigma1 = 12;    // N m s/rad
  double z_ = 0;                           // rad
};

}  // namespace sim
