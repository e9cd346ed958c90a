#include "realtime/trajectories/time_optimal_joint.hpp"

#include <algorithm>

#include "realtime/check.hpp"
#include "realtime/joint_range.hpp"
#include "realtime/ruckig_planner.hpp"
#include "realtime/trajectories/min_jerk.hpp"

namespace realtime {

struct TimeOptimalJoint::Planner : RuckigPlanner<models::kJoints> {};

TimeOptimalJoint::TimeOptimalJoint(const Parameters& parameters, const models::Limits& limits)
    : planner_(std::make_unique<Planner>()) {
  require_within("speed", -1, parameters.speed, 0.01, 1, "of the limits");
  auto& in = planner_->in;
  for (int i = 0; i < models::kJoints; ++i) {
    require_within("q", i, parameters.q[i], rest_min(limits, i), rest_max(limits, i), "rad");
    const double share = kMotionShare * parameters.speed;
    in.max_velocity[i] = share * limits.dq_max[i];
    in.max_acceleration[i] = share * limits.ddq_max[i];
    in.max_jerk[i] = share * limits.dddq_max[i];
    in.target_position[i] = parameters.q[i];
    in.target_velocity[i] = in.target_acceleration[i] = 0;
  }
  goal_.joint.q = parameters.q;
}

TimeOptimalJoint::~TimeOptimalJoint() = default;

void TimeOptimalJoint::start(const Reference& from) noexcept {
  auto& in = planner_->in;
  for (int i = 0; i < models::kJoints; ++i) {
    in.current_position[i] = from.joint.q[i];
    in.current_velocity[i] = from.joint.dq[i];
    in.current_acceleration[i] = from.joint.ddq[i];
  }
  // Where there is no such motion the limiter, which only sees the goal, makes one.
  const bool planned = planner_->plan();
  duration_ = planned ? planner_->trajectory.get_duration() : 0;
}

bool TimeOptimalJoint::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration_) {
    reference = goal_;
    return true;
  }
  std::array<double, models::kJoints> q, dq, ddq;
  planner_->trajectory.at_time(std::max(time, 0.0), q, dq, ddq);
  reference.motion = Channels::kJoint;
  reference.joint.q = Vector7::Map(q.data());
  reference.joint.dq = Vector7::Map(dq.data());
  reference.joint.ddq = Vector7::Map(ddq.data());
  return false;
}

}  // namespace realtime
