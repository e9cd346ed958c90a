#include "realtime/controllers/admittance.hpp"

#include "realtime/check.hpp"
#include "realtime/controllers/felt_wrench.hpp"
#include "realtime/rotation.hpp"

namespace realtime {
namespace {

constexpr double kNullspaceStiffness = 10;  // N m/rad

}  // namespace

Admittance::Admittance(const Parameters& parameters)
    : parameters_(parameters),
      follower_({Vector3::Constant(parameters.translational_tracking), Vector3::Constant(parameters.rotational_tracking), 1,
                 kNullspaceStiffness}) {
  for (int i = 0; i < 6; ++i) {
    const bool linear = i < 3;
    require_within("mass", i, parameters.mass[i], linear ? 0.5 : 0.01, linear ? 100 : 10, linear ? "kg" : "kg m^2");
    require_within("damping", i, parameters.damping[i], 0, linear ? 2000 : 200, linear ? "N s/m" : "N m s/rad");
    require_within("stiffness", i, parameters.stiffness[i], 0, linear ? 3000 : 300, linear ? "N/m" : "N m/rad");
  }
  require_within("translational_tracking", -1, parameters.translational_tracking, 100, 3000, "N/m");
  require_within("rotational_tracking", -1, parameters.rotational_tracking, 10, 300, "N m/rad");
}

void Admittance::start(const Cycle& cycle, Reference& reference) noexcept {
  stay();
  follower_.start(cycle, reference);
}

void Admittance::stay() noexcept {
  position_.setZero();
  orientation_.setIdentity();
  velocity_.setZero();
}

void Admittance::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  const Parameters& p = parameters_;
  const double dt = cycle.dt;
  Vector6 x;
  x << position_, log(orientation_);
  // Backward in time: stable with any values.
  const Vector6 before = velocity_;
  const Vector6 push = -felt_wrench(cycle) - p.stiffness.cwiseProduct(x);
  velocity_ = (p.mass.cwiseProduct(before) + dt * push)
                  .cwiseQuotient(p.mass + dt * p.damping + dt * dt * p.stiffness);
  position_ += dt * velocity_.head<3>();
  orientation_ = (exp(dt * velocity_.tail<3>()) * orientation_).normalized();

  Reference moved = reference;
  moved.cartesian.position += position_;
  moved.cartesian.orientation = orientation_ * reference.cartesian.orientation;
  moved.cartesian.velocity += velocity_;
  moved.cartesian.acceleration += (velocity_ - before) / dt;
  follower_.step(cycle, moved, tau_J_d);
}

}  // namespace realtime
