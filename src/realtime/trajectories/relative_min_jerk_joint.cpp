#include "realtime/trajectories/relative_min_jerk_joint.hpp"

#include "realtime/check.hpp"
#include "realtime/joint_range.hpp"

namespace realtime {

RelativeMinJerkJoint::RelativeMinJerkJoint(const Parameters& parameters, const models::Limits& limits)
    : MinJerkJoint(parameters.duration, limits), delta_q_(parameters.delta_q) {
  for (int i = 0; i < models::kJoints; ++i) {
    const double range = rest_max(limits, i) - rest_min(limits, i);
    require_within("delta_q", i, delta_q_[i], -range, range, "rad");
  }
}

void RelativeMinJerkJoint::start(const Reference& from) noexcept {
  shortened_ = false;
  for (int i = 0; i < models::kJoints; ++i) {
    const double wanted = from.joint.q[i] + delta_q_[i];
    goal_.joint.q[i] = std::clamp(wanted, rest_min(limits_, i), rest_max(limits_, i));
    shortened_ |= goal_.joint.q[i] != wanted;
  }
  MinJerkJoint::start(from);
}

}  // namespace realtime
