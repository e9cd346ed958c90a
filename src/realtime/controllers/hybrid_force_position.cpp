#include "realtime/controllers/hybrid_force_position.hpp"

#include "realtime/check.hpp"
#include "realtime/cholesky.hpp"
#include "realtime/controllers/felt_wrench.hpp"
#include "realtime/inertia_along.hpp"

namespace realtime {
namespace {

CartesianImpedance::Parameters motion(const HybridForcePosition::Parameters& parameters) {
  CartesianImpedance::Parameters out{parameters.translational_stiffness, parameters.rotational_stiffness,
                                     parameters.damping_ratio, parameters.nullspace_stiffness, parameters.frame};
  for (int i = 0; i < 3; ++i) {
    if (parameters.force_axes[i] != 0) out.translational_stiffness[i] = 0;
    if (parameters.force_axes[i + 3] != 0) out.rotational_stiffness[i] = 0;
  }
  return out;
}

}  // namespace

HybridForcePosition::HybridForcePosition(const Parameters& parameters)
    : parameters_(parameters),
      tracks_(parameters.force_axes.isZero(0)),
      motion_(motion(parameters)) {
  for (int i = 0; i < 6; ++i) {
    require_within("force", i, parameters.force[i], i < 3 ? -100 : -20, i < 3 ? 100 : 20, i < 3 ? "N" : "N m");
    if (parameters.force_axes[i] != 1) require_within("force_axes", i, parameters.force_axes[i], 0, 0, "or be 1");
    if (parameters.force_axes[i] == 0) require_within("force", i, parameters.force[i], 0, 0, "where force_axes is 0");
  }
  require_within("gain", -1, parameters.gain, 0, 2, "");
  require_within("integral_gain", -1, parameters.integral_gain, 0, 20, "1/s");
  require_within("max_speed", -1, parameters.max_speed, 0.001, 0.2, "m/s");
  require_within("max_turning_speed", -1, parameters.max_turning_speed, 0.01, 1, "rad/s");
}

// The reference without what it wants along force axes.
Reference HybridForcePosition::of_motion(const Cycle& cycle, const Reference& reference) const noexcept {
  Reference out = reference;
  if (tracks_) return out;
  Vector6 velocity = motion_.in_frame(cycle, reference.cartesian.velocity);
  Vector6 acceleration = motion_.in_frame(cycle, reference.cartesian.acceleration);
  for (int i = 0; i < 6; ++i) {
    if (parameters_.force_axes[i] != 0) velocity[i] = acceleration[i] = 0;
  }
  out.cartesian.velocity = motion_.in_base(cycle, velocity);
  out.cartesian.acceleration = motion_.in_base(cycle, acceleration);
  return out;
}

void HybridForcePosition::start(const Cycle& cycle, Reference& reference) noexcept {
  for (ForceServo& each : servos_) each.start();
  Reference moved = of_motion(cycle, reference);
  motion_.start(cycle, moved);
  reference.cartesian.position = moved.cartesian.position;
  reference.cartesian.orientation = moved.cartesian.orientation;
}

void HybridForcePosition::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  const Parameters& p = parameters_;
  motion_.step(cycle, of_motion(cycle, reference), tau_J_d);
  if (tracks_) return;
  const Matrix67& J = cycle.model.jacobian();
  const Cholesky<7> M(cycle.model.mass());
  const Vector6 wanted = p.force + motion_.in_frame(cycle, reference.wrench);
  const Vector6 felt = motion_.in_frame(cycle, felt_wrench(cycle));
  const Vector6 v = motion_.in_frame(cycle, J * cycle.dq);
  for (int i = 0; i < 6; ++i) {
    if (p.force_axes[i] == 0) continue;
    const Vector6 axis = motion_.in_base(cycle, Vector6::Unit(i));
    const Vector7 torque = J.transpose() * axis;
    const double v_max = i < 3 ? p.max_speed : p.max_turning_speed;
    const double inertia = inertia_along(M, torque);
    const double f = servos_[i].step(wanted[i], felt[i], v[i], v_max, inertia, p.gain, p.integral_gain, cycle.dt);
    tau_J_d += f * torque;
  }
}

}  // namespace realtime
