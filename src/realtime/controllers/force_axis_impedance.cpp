#include "realtime/controllers/force_axis_impedance.hpp"

#include "realtime/check.hpp"

namespace realtime {
namespace {

constexpr double kNullspaceStiffness = 10;  // N m/rad

Vector3 direction(const Vector3& axis) {
  require_within("norm of axis", -1, axis.norm(), 1e-6, 1e6, "");
  return axis.normalized();
}

// Stiffness in a frame whose z is the axis.
CartesianImpedance::Parameters spring(const ForceAxisImpedance::Parameters& parameters) {
  const double K = parameters.translational_stiffness, K_rotation = parameters.rotational_stiffness;
  require_within("translational_stiffness", -1, K, 0, 3000, "N/m");
  require_within("rotational_stiffness", -1, K_rotation, 0, 300, "N m/rad");
  CartesianImpedance::Parameters out{Vector3(K, K, 0), Vector3::Constant(K_rotation), 1, kNullspaceStiffness};
  const Vector3 z = direction(parameters.axis), x = z.unitOrthogonal();
  out.axes << x, z.cross(x), z;
  return out;
}

}  // namespace

ForceAxisImpedance::ForceAxisImpedance(const Parameters& parameters)
    : axis_(direction(parameters.axis)), cap_(parameters.max_translation, 0), spring_(spring(parameters)) {
  require_within("max_translation", -1, parameters.max_translation, 0, 2, "m");
}

// The elbow does not follow the trajectory's reference either.
Cycle ForceAxisImpedance::at_posture(const Cycle& cycle) const noexcept {
  Cycle held = cycle;
  held.q_ref = posture_;
  held.dq_ref.setZero();
  return held;
}

void ForceAxisImpedance::start(const Cycle& cycle, Reference&) noexcept {
  cap_.start(cycle);
  line_ = {};
  line_.motion = Channels::kPose;
  line_.cartesian.position = cycle.O_T_EE.translation();
  line_.cartesian.orientation = Eigen::Quaterniond(cycle.O_T_EE.linear());
  posture_ = cycle.q;
  spring_.start(at_posture(cycle), line_);
}

void ForceAxisImpedance::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  const double share = cap_.share(cycle);
  const Vector3 force = share * axis_.dot(reference.wrench.head<3>()) * axis_;
  spring_.step(at_posture(cycle), line_, tau_J_d);
  tau_J_d.noalias() += cycle.model.jacobian().topRows<3>().transpose() * force;
  tau_J_d += cap_.damping(cycle, share);
}

}  // namespace realtime
