#pragma once

#include <optional>

#include "realtime/controllers/controller.hpp"

namespace realtime {

// A spring and damper in each joint about the reference, with the arm's dynamics fed forward:
//   tau_J_d = (K e + D de + i) / s - (1/s - 1) tau_ext + coriolis(q, dq) + M(q) ddq_ref
// e = q_ref - q. With s = 1 and without integral i that is K e + D de + coriolis + M ddq_ref.
//
// D is given, or made such that each mode of s (M + motors) and K has a damping ratio: with M = L L^T and
// L^-1 K L^-T = V W² V^T, D = 2 ratio L V W V^T L^T (less where the delay of the loop does not allow it).
// s scales the inertia that a hand feels, links and all: s M ddq~ = K e + D de + tau of the hand (Ott, Cartesian impedance
// control of redundant and flexible-joint robots, Springer 2008, ch. 3). tau_ext, what the joints exert, is the robot's
// estimate, which is some 10 ms old: what is faster is felt as without.
// i is the sum of r K e dt, bounded: with friction the arm then comes to its reference. r is at most a quarter of the least damped
// mode's damping, and i does not grow while another torque leaves than is asked for (as of CartesianImpedance).
class JointImpedance : public Controller {
 public:
  struct Parameters {
    Vector7 stiffness;  // K, N m/rad, 0 to 3000
    Vector7 damping;    // D, N m s/rad, 0 to 200; means nothing beside a ratio
    std::optional<double> damping_ratio = {};  // 0.1 to 3
    double inertia_scale = 1;   // s, 0.5 to 4
    double integral_rate = 0;   // r, 1/s, 0 to 10
    double integral_limit = 0;  // of i, N m, 0 to 20
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit JointImpedance(const Parameters& parameters);
  // With the mass matrix where the arm begins: what no loop of 1 ms could hold is refused as well (require_holdable()); what it could
  // not hold where the arm is later is softened.
  JointImpedance(const Parameters& parameters, const Matrix7& mass);

  Channels takes() const noexcept override { return Channels::kJoint; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }
  Vector7 led_joints(const Vector7& way) const noexcept override { return (parameters_.stiffness.array() > 0).select(way, 0); }

  // Moves q_ref of the joints that have stiffness.
  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void stay() noexcept override { integral_.setZero(); }
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

 private:
  void torque(const Cycle& cycle, const JointReference& reference, Vector7& tau_J_d) noexcept;
  void find_gains(const Matrix7& mass) noexcept;

  Parameters parameters_;
  Vector7 stiffness_;         // N m/rad, that is held
  Matrix7 damping_;           // N m s/rad
  int gains_age_ = 0;         // cycles
  double least_damping_ = 0;            // 1/s, of the modes that have a spring
  Vector7 integral_ = Vector7::Zero();  // N m
  Vector7 asked_ = Vector7::Zero();     // N m, in the cycle before
};

}  // namespace realtime
