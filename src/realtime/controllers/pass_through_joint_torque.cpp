#include "realtime/controllers/pass_through_joint_torque.hpp"

#include <algorithm>

#include "models/arm.hpp"
#include "realtime/base_gravity.hpp"
#include "realtime/check.hpp"
#include "realtime/controllers/require_holdable.hpp"
#include "realtime/felt_inertia.hpp"

namespace realtime {
namespace {

constexpr double kMaxShift = 0.2;  // rad, of q_start
constexpr double kGiveWay = 0.1;   // s

// Where what is among the gains, and the first of them in the message.
constexpr int kSelection = 0, kRemoveGravity = 7, kTorque = 14, kStiffness = 21, kDamping = 28;
constexpr std::size_t kFirst = 2;

using Gains = GainStream<35>::Gains;

Gains gains_of(const PassThroughJointTorque::Parameters& p) {
  Gains gains;
  gains << p.selection, p.remove_gravity, p.torque, p.stiffness, p.damping;
  return gains;
}

void check(const Gains& gains, const Matrix7& inertia) {
  for (int i = 0; i < models::kJoints; ++i) {
    require_within("torque", i, gains[kTorque + i], -100, 100, "N m");
    require_within("selection", i, gains[kSelection + i], 0, 1, "");
    require_within("remove_gravity", i, gains[kRemoveGravity + i], 0, 1, "");
    require_within("stiffness", i, gains[kStiffness + i], 0, 3000, "N m/rad");
    require_within("damping", i, gains[kDamping + i], 0, 200, "N m s/rad");
  }
  const Vector7 held = Vector7::Ones() - gains.segment<7>(kSelection);
  require_holdable(held.cwiseProduct(gains.segment<7>(kStiffness)), held.cwiseProduct(gains.segment<7>(kDamping)), inertia);
}

}  // namespace

PassThroughJointTorque::PassThroughJointTorque(const Parameters& parameters, const Matrix7& mass)
    : gains_(gains_of(parameters), parameters.topic, "JointTorqueControllerSensorMessage", kFirst,
             [inertia = felt_inertia(mass)](const Gains& gains) { check(gains, inertia); }, parameters.timeout),
      timeout_(parameters.timeout) {
  require_within("timeout", -1, timeout_, 0, 3600, "s");
}

void PassThroughJointTorque::start(const Cycle& cycle, Reference& reference) noexcept {
  q_start_ = cycle.q;
  const Vector7 tau = law(cycle, reference);
  Vector7 springs = gains_.now().segment<7>(kStiffness), damping = gains_.now().segment<7>(kDamping);
  keep_holdable(joint_mobility(cycle.model.mass()), springs, damping);
  for (int i = 0; i < models::kJoints; ++i) {
    const double stiffness = (1 - gains_.now()[kSelection + i]) * springs[i];
    if (stiffness == 0) continue;
    q_start_[i] += std::clamp((cycle.tau_J_d[i] - tau[i]) / stiffness, -kMaxShift, kMaxShift);
  }
}

void PassThroughJointTorque::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  gains_.step(cycle.dt);
  const bool silent = gains_.changes() && timeout_ > 0 && gains_.silent() > timeout_;
  given_ = std::clamp(given_ + (silent ? -cycle.dt : cycle.dt) / kGiveWay, 0., 1.);
  tau_J_d = law(cycle, reference);
}

Vector7 PassThroughJointTorque::law(const Cycle& cycle, const Reference& reference) const noexcept {
  const Gains& gains = gains_.now();
  const Vector7 remove_gravity = gains.segment<7>(kRemoveGravity);
  Vector7 K = gains.segment<7>(kStiffness), D = gains.segment<7>(kDamping);
  keep_holdable(joint_mobility(cycle.model.mass()), K, D);
  const Vector7 damping = -D.cwiseProduct(cycle.dq);
  const Vector7 held = K.cwiseProduct(q_start_ - cycle.q) + damping;
  const Vector7 torque = given_ * (gains_.goal().segment<7>(kTorque) + reference.torque) + (1 - given_) * damping;
  Vector7 tau = held + gains.segment<7>(kSelection).cwiseProduct(torque - held) + cycle.model.coriolis();
  if (remove_gravity.isZero()) return tau;
  tau -= remove_gravity.cwiseProduct(cycle.model.gravity(base_gravity(cycle.state)));
  return tau;
}

}  // namespace realtime
