#include "realtime/controllers/joint_impedance.hpp"

#include <algorithm>

#include "models/arm.hpp"
#include "realtime/check.hpp"

namespace realtime {
namespace {

// rad; what a soft joint would need beyond this is left to the torque limiter.
constexpr double kMaxShift = 0.2;

}  // namespace

JointImpedance::JointImpedance(const Parameters& parameters)
    : stiffness_(parameters.stiffness), damping_(parameters.damping) {
  for (int i = 0; i < models::kJoints; ++i) {
    require_within("stiffness", i, stiffness_[i], 0, 3000, "N m/rad");
    require_within("damping", i, damping_[i], 0, 200, "N m s/rad");
  }
}

void JointImpedance::start(const Cycle& cycle, Reference& reference) noexcept {
  Vector7 tau;
  step(cycle, reference, tau);
  for (int i = 0; i < models::kJoints; ++i) {
    if (stiffness_[i] == 0) continue;
    const double shift = (cycle.tau_J_d[i] - tau[i]) / stiffness_[i];
    reference.joint.q[i] += std::clamp(shift, -kMaxShift, kMaxShift);
  }
}

void JointImpedance::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  const JointReference& r = reference.joint;
  tau_J_d.noalias() = cycle.model.mass() * r.ddq;
  tau_J_d += stiffness_.cwiseProduct(r.q - cycle.q) + damping_.cwiseProduct(r.dq - cycle.dq) + cycle.model.coriolis();
}

}  // namespace realtime
