#include "realtime/trajectories/joint_dmp.hpp"

#include "realtime/joint_range.hpp"

namespace realtime {
namespace {

DmpSensors<7> rollout(const JointDmp::Parameters& parameters) {
  require_within("duration", -1, parameters.duration, 0.001, 120, "s");
  const DmpForcing<7> forcing("", parameters.force, FirstBasis::kMinJerk, false);
  const double tau = parameters.spring.tau;
  return {"", parameters.spring, parameters.duration, forcing, 0, parameters.force.topic, false, [&](int sensor) {
            return [&, sensor](double t) { return forcing.at(std::exp(-tau * t), 2 * tau * t, sensor); };
          }};
}

}  // namespace

JointDmp::JointDmp(const Parameters& parameters, const models::Limits& limits)
    : limits_(limits), rollout_(rollout(parameters)) {
  visit_rates(rollout_, [&](const auto& v, const auto& a, const Vector7& j) {
    for (int i = 0; i < models::kJoints; ++i) {
      slower_ =
          std::max(slower_, slower(std::abs(v.forced[i]), std::abs(a.forced[i]), std::abs(j[i]), rates(limits_, i)));
    }
  });
}

void JointDmp::start(const Reference& from) noexcept {
  rollout_.start();
  motion_.start(rollout_, from.joint.q, Vector7::Zero(), from.joint.dq, slower_);
  const auto end = motion_.at_cut();
  double decay = 0;
  for (int i = 0; i < models::kJoints; ++i) {
    decay = std::max(decay, decay_duration(std::abs(end.dy[i]), std::abs(end.ddy[i]), rates(limits_, i)));
  }
  set_goal(motion_.come_to_rest(decay));
}

void JointDmp::set_goal(const Vector7& q) noexcept {
  for (int i = 0; i < models::kJoints; ++i)
    goal_.joint.q[i] = std::clamp(q[i], rest_min(limits_, i), rest_max(limits_, i));
  shortened_ = goal_.joint.q != q;
}

bool JointDmp::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration()) {
    reference = goal_;
    return true;
  }
  if (time < motion_.cut() && rollout_.take(motion_.clock(time))) set_goal(motion_.come_to_rest());
  const auto point = motion_.at(time);
  reference.motion = Channels::kJoint;
  reference.joint = {point.y, point.dy, point.ddy};
  return false;
}

}  // namespace realtime
