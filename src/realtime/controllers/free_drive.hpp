#pragma once

#include "models/arm.hpp"
#include "realtime/check.hpp"
#include "realtime/controllers/controller.hpp"

namespace realtime {

// Lets the arm be led by hand: gravity, which the robot compensates, and Coriolis torques are balanced, and what moves is
// damped. It follows no reference, tau_J_d = coriolis - D dq + friction. Dry friction holds what nobody leads against what
// the robot knows wrongly of its load: a damped spring, which slips at its torque.
class FreeDrive : public Controller {
 public:
  struct Parameters {
    Vector7 damping;   // N m s/rad, 0 to 200
    Vector7 friction;  // N m, 0 to 10
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit FreeDrive(const Parameters& parameters);

  Channels takes() const noexcept override { return Channels::kJoint | Channels::kPose; }
  bool tracks() const noexcept override { return false; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }

  void start(const Cycle& cycle, Reference&) noexcept override { held_ = cycle.q; }
  void step(const Cycle& cycle, const Reference&, Vector7& tau_J_d) noexcept override;

 private:
  const Vector7 damping_, friction_;
  const Vector7 most_;  // rad that a joint may be away from where it is held
  Vector7 held_;        // rad
};

}  // namespace realtime
