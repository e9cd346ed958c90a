#pragma once

#include "realtime/controllers/controller.hpp"

namespace realtime {

// Spring and damper between EE and its reference, with the arm's dynamics (Khatib, A unified approach for
// motion and force control of robot manipulators, IEEE J. Robotics and Automation 3(1), 1987, and for
// damping and null space Albu-Schäffer, Ott, Frese, Hirzinger, Cartesian impedance control of redundant
// robots, ICRA 2003):
//
//   tau_J_d = J^T (K e + D (v_ref - v) + Lambda (a_ref - dJ dq)) + coriolis + tau_null
//
// e is the way to the reference: position along the axes of O, and the rotation vector in O of the shortest
// rotation to it, right up to 180°. Lambda = (J M^-1 J^T)^-1. D is designed with it, so that each mode of
// Lambda, D, K has the damping ratio (less where the delay of the loop does not allow it). tau_null holds
// the motion of the elbow that leaves EE at rest to the posture at the start, critically damped, and does
// not accelerate EE. Lambda counts the links alone: the inertia of the motors makes the arm less damped
// than asked.
class CartesianImpedance : public Controller {
 public:
  struct Parameters {
    Vector3 translational_stiffness;  // N/m, 0 to 3000, along the axes of O
    Vector3 rotational_stiffness;     // N m/rad, 0 to 300, about the axes of O
    double damping_ratio;             // 0 to 3
    double nullspace_stiffness;       // N m/rad, 0 to 100
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit CartesianImpedance(const Parameters& parameters);

  bool accepts(ReferenceKind kind) const noexcept override { return kind == ReferenceKind::kCartesian; }
  robot::Mode mode(ReferenceKind) const noexcept override { return robot::kTorque; }

  // Moves the reference pose where there is stiffness, and the posture for the null space.
  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

 private:
  Vector6 stiffness_;
  double damping_ratio_, nullspace_stiffness_;
  Vector7 posture_ = Vector7::Zero();  // rad, for the null space
};

}  // namespace realtime
