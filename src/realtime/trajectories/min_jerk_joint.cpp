#include "realtime/trajectories/min_jerk_joint.hpp"

#include "realtime/check.hpp"
#include "realtime/joint_range.hpp"

namespace realtime {
MinJerkJoint::MinJerkJoint(double duration, const models::Limits& limits) : limits_(limits), asked_duration_(duration) {
  require_within("duration", -1, duration, 0.001, 3600, "s");
}

MinJerkJoint::MinJerkJoint(const Parameters& parameters, const models::Limits& limits)
    : MinJerkJoint(parameters.duration, limits) {
  for (int i = 0; i < models::kJoints; ++i) {
    require_within("q", i, parameters.q[i], rest_min(limits, i), rest_max(limits, i), "rad");
  }
  goal_.joint.q = parameters.q;
}

void MinJerkJoint::start(const Reference& from) noexcept {
  double decay = 0;
  for (int i = 0; i < models::kJoints; ++i) {
    decay = std::max(decay, decay_duration(std::abs(from.joint.dq[i]), std::abs(from.joint.ddq[i]), rates(limits_, i)));
  }
  motion_.start(from.joint.q, from.joint.dq, from.joint.ddq, goal_.joint.q, decay);

  double T = asked_duration_;
  bool envelope = false;
  for (int i = 0; i < models::kJoints; ++i) {
    T = std::max(T, least_duration(std::abs(motion_.way()[i]), rates(limits_, i)));
    envelope |= limits_.envelope_deceleration[i] != 0;
  }
  const auto set_duration = [&](double duration) {
    motion_.set_duration(duration);
    return motion_.duration();
  };
  set_duration(T);
  if (envelope || motion_.moving()) {
    realtime::stretch(T, set_duration, [&](double t, double& worst) { raise_at(t, worst); });
  }
  stretch_ = T / asked_duration_;
}

void MinJerkJoint::raise_at(double t, double& worst) const noexcept {
  // The limiter wants room to brake under the envelope, which near its end is this much; rad/s.
  constexpr double kEnvelopeRoom = 0.025;
  const auto point = motion_.at(t);
  for (int i = 0; i < models::kJoints; ++i) {
    double v_max = limits_.dq_max[i];
    if (limits_.envelope_deceleration[i] != 0) {
      v_max = point.v[i] > 0 ? limits_.dq_upper(i, point.x[i]) : -limits_.dq_lower(i, point.x[i]);
      v_max = std::max(v_max - kEnvelopeRoom, 1e-3);
    }
    // What it begins with, no duration mends.
    if (std::abs(point.v_timed[i]) < 0.01 * v_max || std::abs(point.v[i] - point.v_timed[i]) > 0.9 * v_max) {
      continue;
    }
    raise(worst, std::abs(point.v[i]) / (kMotionShare * v_max),
          std::abs(point.a[i]) / (kMotionShare * limits_.ddq_max[i]),
          std::abs(point.j[i]) / (kMotionShare * limits_.dddq_max[i]));
  }
}

bool MinJerkJoint::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= motion_.duration()) {
    reference = goal_;
    return true;
  }
  const auto point = motion_.at(time);
  reference.motion = Channels::kJoint;
  reference.joint.q = point.x;
  reference.joint.dq = point.v;
  reference.joint.ddq = point.a;
  return false;
}

}  // namespace realtime
