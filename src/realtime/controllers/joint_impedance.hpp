#pragma once

#include "realtime/controllers/controller.hpp"

namespace realtime {

// A spring and damper in each joint about the reference, with the arm's dynamics fed forward:
//   tau_J_d = K (q_ref - q) + D (dq_ref - dq) + coriolis(q, dq) + M(q) ddq_ref
class JointImpedance : public Controller {
 public:
  struct Parameters {
    Vector7 stiffness;  // K, N m/rad, 0 to 3000
    Vector7 damping;    // D, N m s/rad, 0 to 200
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit JointImpedance(const Parameters& parameters);

  bool accepts(ReferenceKind kind) const noexcept override { return kind == ReferenceKind::kJoint; }
  robot::Mode mode(ReferenceKind) const noexcept override { return robot::kTorque; }

  // Moves q_ref of the joints that have stiffness.
  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

 private:
  Vector7 stiffness_, damping_;
};

}  // namespace realtime
