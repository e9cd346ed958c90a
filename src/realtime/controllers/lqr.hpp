#pragma once

#include <cmath>

#include "realtime/arm.hpp"
#include "realtime/controllers/controller.hpp"

namespace realtime {

// A linear-quadratic regulator of the joints about the posture in which the skill begins:
//   tau_J_d = K (q_ref - q) + D (dq_ref - dq) + M(q) ddq_ref + coriolis(q, dq)
// With gravity, Coriolis torques and the reference's acceleration compensated, the difference x = (q - q_ref, dq - dq_ref)
// is that of a double integrator with the inertia of the posture, links and motors (models/joint_figures.hpp), sampled at 1 ms.
// [K D], full matrices, minimise the sum of x^T Q x + u^T R u over its cycles: K, D = (R + B^T P B)^-1 B^T P A, and P solves
// the discrete algebraic Riccati equation P = A^T P (I + B R^-1 B^T P)^-1 A + Q, here by structure-preserving doubling (Chu,
// Fan, Lin, Wang, Structure-preserving algorithms for periodic discrete-time algebraic Riccati equations, Int. J. Control
// 77(8), 2004). Weights whose loop would not be stable with torque a cycle late are refused; where the arm is lighter later than it
// was there, K and D are made less together, as far as a loop can hold them.
class Lqr : public Controller {
 public:
  struct Parameters {
    Vector7 position_weight;  // of Q, 1/rad², 1e-3 to 1e8
    Vector7 velocity_weight;  // of Q, s²/rad², 0 to 1e6
    Vector7 torque_weight;    // of R, 1/(N m)², 1e-3 to 1e6
  };

  // Throws std::invalid_argument naming field, value and bound. `mass`: of the links in the posture.
  Lqr(const Parameters& parameters, const Matrix7& mass);

  Channels takes() const noexcept override { return Channels::kJoint; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }

  // Moves q_ref.
  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

  const Matrix7& K() const noexcept { return K_; }  // N m/rad
  const Matrix7& D() const noexcept { return D_; }  // N m s/rad

 private:
  void find_fastest(const Matrix7& mobility) noexcept;

  Matrix7 K_, D_, K_inverse_;
  Vector7 fastest_ = Vector7::Constant(1 / std::sqrt(7.));  // direction of the joints that is damped the fastest
  double share_ = 1;                                        // of K and D
  int age_ = 0;                                             // cycles
};

}  // namespace realtime
