#include "realtime/controllers/joint_impedance.hpp"

#include <algorithm>
#include <cmath>

#include "models/arm.hpp"
#include "realtime/check.hpp"
#include "realtime/cholesky.hpp"
#include "realtime/controllers/fastest_damping.hpp"
#include "realtime/controllers/integral.hpp"
#include "realtime/controllers/joint_friction.hpp"
#include "realtime/controllers/require_holdable.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/symmetric_eigen.hpp"

namespace realtime {
namespace {

// rad; what a soft joint would need beyond this is left to the torque limiter.
constexpr double kMaxShift = 0.2;
// Cycles after which gains are found anew for where the arm is.
constexpr int kGainsAge = 16;
constexpr double kNoMode = 1e-6;  // 1/s², of a mode without a spring

}  // namespace

JointImpedance::JointImpedance(const Parameters& parameters)
    : parameters_(parameters), stiffness_(parameters.stiffness), damping_(parameters.damping.asDiagonal()) {
  for (int i = 0; i < models::kJoints; ++i) {
    require_within("stiffness", i, parameters.stiffness[i], 0, 3000, "N m/rad");
    require_within("damping", i, parameters.damping[i], 0, 200, "N m s/rad");
  }
  if (parameters.damping_ratio) require_within("damping_ratio", -1, *parameters.damping_ratio, 0.1, 3, "");
  require_within("inertia_scale", -1, parameters.inertia_scale, 0.5, 4, "");
  require_within("integral_rate", -1, parameters.integral_rate, 0, 10, "1/s");
  require_within("integral_limit", -1, parameters.integral_limit, 0, 20, "N m");
}

JointImpedance::JointImpedance(const Parameters& parameters, const Matrix7& mass) : JointImpedance(parameters) {
  const double s = parameters.inertia_scale;
  if (parameters.damping_ratio) {
    // Modes have their damping by themselves; what is left to ask is whether any does for this stiffness.
    require_holdable(parameters.stiffness / s, 500 * inertia_to_hold(joint_mobility(mass)), felt_inertia(mass));
  } else {
    require_holdable(parameters.stiffness / s, parameters.damping / s, felt_inertia(mass));
  }
}

// What the loop can hold of the gains that are given, or the damping of a ratio.
void JointImpedance::find_gains(const Matrix7& mass) noexcept {
  gains_age_ = 0;
  if (!parameters_.damping_ratio) {
    Vector7 damping = parameters_.damping;
    stiffness_ = parameters_.stiffness;
    keep_holdable(joint_mobility(mass) / parameters_.inertia_scale, stiffness_, damping);
    damping_ = damping.asDiagonal();
    // No mode of these joints is damped less than the one whose inertia all of its row adds to (Gershgorin).
    const Vector7 inertia = parameters_.inertia_scale * felt_inertia(mass).cwiseAbs().rowwise().sum();
    least_damping_ = (stiffness_.array() > 0).select(damping.cwiseQuotient(inertia), kFastestDamping).minCoeff();
    return;
  }
  const Cholesky<models::kJoints> inertia(parameters_.inertia_scale * felt_inertia(mass));
  Matrix7 half;
  for (int i = 0; i < models::kJoints; ++i) {
    half.col(i) = inertia.solve_L(std::sqrt(parameters_.stiffness[i]) * Vector7::Unit(i));
  }
  const SymmetricEigen<models::kJoints> modes(half.lazyProduct(half.transpose()));
  const Vector7 rate =
      (2 * *parameters_.damping_ratio * modes.values.cwiseMax(0).cwiseSqrt()).cwiseMin(kFastestDamping);
  least_damping_ = (modes.values.array() > kNoMode).select(rate, kFastestDamping).minCoeff();
  const Matrix7 root = inertia.L().lazyProduct(modes.vectors);
  damping_ = root.lazyProduct(rate.asDiagonal() * root.transpose());
}

void JointImpedance::start(const Cycle& cycle, Reference& reference) noexcept {
  integral_.setZero();
  asked_ = cycle.tau_J_d;
  find_gains(cycle.model.mass());
  Vector7 tau;
  torque(cycle, reference.joint, tau);
  for (int i = 0; i < models::kJoints; ++i) {
    if (stiffness_[i] == 0) continue;
    const double shift = (cycle.tau_J_d[i] - tau[i]) * parameters_.inertia_scale / stiffness_[i];
    reference.joint.q[i] += std::clamp(shift, -kMaxShift, kMaxShift);
  }
}

void JointImpedance::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  if (++gains_age_ >= kGainsAge) find_gains(cycle.model.mass());
  if (parameters_.integral_rate > 0) {
    const Vector7 spring = stiffness_.cwiseProduct(reference.joint.q - cycle.q);
    const Vector7 limit = Vector7::Constant(parameters_.integral_limit);
    integrate(cycle, asked_, spring, parameters_.integral_rate, least_damping_, limit, integral_);
  }
  torque(cycle, reference.joint, tau_J_d);
  asked_ = tau_J_d;
}

void JointImpedance::torque(const Cycle& cycle, const JointReference& r, Vector7& tau_J_d) noexcept {
  const Parameters& p = parameters_;
  tau_J_d = stiffness_.cwiseProduct(r.q - cycle.q) + integral_;
  tau_J_d.noalias() += damping_ * (r.dq - cycle.dq);
  if (p.inertia_scale != 1) {
    const Vector7 tau_ext = Vector7::Map(cycle.state.tau_ext_hat_filtered.data());
    tau_J_d /= p.inertia_scale;
    if (tau_ext.allFinite()) tau_J_d -= (1 / p.inertia_scale - 1) * tau_ext;
  }
  tau_J_d.noalias() += felt_inertia(cycle.model.mass()) * r.ddq;
  tau_J_d += cycle.model.coriolis() + against_friction(r.dq);
}

}  // namespace realtime
