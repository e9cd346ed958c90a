#include "realtime/controllers/free_drive.hpp"

namespace realtime {
namespace {

// What holds a joint that nobody leads: springs that no hand feels as such (0.6 N m at 0.2 degrees), damped by their
// own torque alone, so that what slips is not.
const Vector7 kStiffness = (Vector7() << 200, 200, 200, 200, 50, 50, 50).finished();  // N m/rad
const Vector7 kDamping = (Vector7() << 20, 20, 20, 20, 2, 2, 2).finished();           // N m s/rad

}  // namespace

FreeDrive::FreeDrive(const Parameters& parameters)
    : damping_(parameters.damping),
      friction_(parameters.friction),
      most_(parameters.friction.cwiseQuotient(kStiffness)) {
  for (int i = 0; i < models::kJoints; ++i) {
    require_within("damping", i, damping_[i], 0, 200, "N m s/rad");
    require_within("friction", i, friction_[i], 0, 10, "N m");
  }
}

void FreeDrive::step(const Cycle& cycle, const Reference&, Vector7& tau_J_d) noexcept {
  held_ = held_.cwiseMax(cycle.q - most_).cwiseMin(cycle.q + most_);
  const Vector7 spring = kStiffness.cwiseProduct(held_ - cycle.q) - kDamping.cwiseProduct(cycle.dq);
  tau_J_d = cycle.model.coriolis() - damping_.cwiseProduct(cycle.dq) + spring.cwiseMax(-friction_).cwiseMin(friction_);
}

}  // namespace realtime
