#pragma once

#include "realtime/check.hpp"
#include "realtime/controllers/controller.hpp"
#include "realtime/controllers/motion_cap.hpp"

namespace realtime {

// Exerts the wrench of the trajectory at EE, and holds nothing:
//   tau_J_d = share J^T wrench + coriolis
// wrench in N and N m along and about the axes of O, by virtual work. `share` is 1, and falls to 0 where EE has moved as far
// from where it was as it may (MotionCap). Without a wrench the arm is as free as under FreeDrive.
class PassThrough : public Controller {
 public:
  struct Parameters {
    double max_translation;  // m, 0 to 2; 0: no cap
    double max_rotation;     // rad, 0 to 3; 0: no cap
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit PassThrough(const Parameters& parameters) : cap_(parameters.max_translation, parameters.max_rotation) {
    require_within("max_translation", -1, parameters.max_translation, 0, 2, "m");
    require_within("max_rotation", -1, parameters.max_rotation, 0, 3, "rad");
  }

  Channels takes() const noexcept override { return Channels::kJoint | Channels::kPose | Channels::kWrench; }
  bool tracks() const noexcept override { return false; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }

  void start(const Cycle& cycle, Reference&) noexcept override { cap_.start(cycle); }
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override {
    const double share = cap_.share(cycle);
    tau_J_d.noalias() = cycle.model.jacobian().transpose() * (share * reference.wrench);
    tau_J_d += cycle.model.coriolis() + cap_.damping(cycle, share);
  }

 private:
  MotionCap cap_;
};

}  // namespace realtime
