#include "realtime/trajectories/timed_joint.hpp"

#include "realtime/check.hpp"
#include "realtime/joint_range.hpp"
#include "realtime/trajectories/min_jerk.hpp"

namespace realtime {

TimedJoint::TimedJoint(TimeLaw law, const Parameters& parameters, const models::Limits& limits)
    : law_(law), limits_(limits), asked_duration_(parameters.duration), duration_(parameters.duration) {
  require_within("duration", -1, parameters.duration, 0.001, 3600, "s");
  for (int i = 0; i < models::kJoints; ++i) {
    require_within("q", i, parameters.q[i], rest_min(limits, i), rest_max(limits, i), "rad");
  }
  goal_.joint.q = parameters.q;
}

void TimedJoint::start(const Reference& from) noexcept {
  from_ = from.joint;
  duration_ = asked_duration_;
  for (int i = 0; i < models::kJoints; ++i) {
    const double way = std::abs(goal_.joint.q[i] - from_.q[i]);
    duration_ = std::max(duration_, least_duration(law_, way, kMotionShare * limits_.dq_max[i],
                                                   kMotionShare * limits_.ddq_max[i]));
  }
}

bool TimedJoint::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration_) {
    reference = goal_;
    return true;
  }
  const double T = duration_;
  const TimeLawPoint p = at(law_, time / T);
  const Vector7 way = goal_.joint.q - from_.q;
  reference.motion = Channels::kJoint;
  reference.joint.q = from_.q + p.s * way + T * p.h * from_.dq;
  reference.joint.dq = p.ds / T * way + p.dh * from_.dq;
  reference.joint.ddq = p.dds / (T * T) * way + p.ddh / T * from_.dq;
  return false;
}

}  // namespace realtime
