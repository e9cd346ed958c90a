#pragma once

#include <optional>

#include "realtime/controllers/controller.hpp"

namespace realtime {

// The robot's own impedance control: joint impedance (K_theta), or Cartesian impedance (K_x), for either
// kind of reference. The robot's stiffness is set before the motion; with neither given to what the arm
// starts up with, as a skill before may have changed it.
class InternalImpedance : public Controller {
 public:
  struct Parameters {                // at most one of the two
    std::optional<Vector7> K_theta;  // N m/rad, 0 to 14250
    std::optional<Vector6> K_x;      // N/m, 10 to 3000; N m/rad, 1 to 300; about the axes of frame K
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit InternalImpedance(const Parameters& parameters);

  Channels takes() const noexcept override { return Channels::kJoint | Channels::kPose; }
  robot::Mode mode(Channels motion) const noexcept override;
  robot::Settings settings() const noexcept override { return settings_; }

  void start(const Cycle&, Reference&) noexcept override {}
  void step(const Cycle&, const Reference&, Vector7& tau_J_d) noexcept override { tau_J_d.setZero(); }

 private:
  robot::Settings settings_;
};

}  // namespace realtime
