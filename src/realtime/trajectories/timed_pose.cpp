#include "realtime/trajectories/timed_pose.hpp"

#include "realtime/check.hpp"
#include "realtime/rotation.hpp"
#include "realtime/trajectories/min_jerk.hpp"
#include "realtime/trajectories/pose_difference.hpp"

namespace realtime {

TimedPose::TimedPose(TimeLaw law, double duration, const models::Limits& limits)
    : law_(law), limits_(limits), asked_duration_(duration), duration_(duration) {
  goal_.motion = Channels::kPose;
  require_within("duration", -1, duration, 0.001, 3600, "s");
}

TimedPose::TimedPose(TimeLaw law, const Parameters& parameters, const models::Limits& limits)
    : TimedPose(law, parameters.duration, limits) {
  for (int i = 0; i < 3; ++i) require_within("position", i, parameters.position[i], -2, 2, "m");
  goal_.cartesian.position = parameters.position;
  goal_.cartesian.orientation = require_rotation("quaternion", parameters.orientation);
}

void TimedPose::start(const Reference& from) noexcept {
  from_ = from.cartesian;
  turn_ = log(goal_.cartesian.orientation * from_.orientation.conjugate());
  duration_ = asked_duration_;
  const auto lengthen = [this](double way, const models::Limits::Rates& limits) {
    duration_ = std::max(duration_, least_duration(law_, way, kMotionShare * limits.velocity,
                                                   kMotionShare * limits.acceleration));
  };
  lengthen((goal_.cartesian.position - from_.position).norm(), limits_.translation);
  lengthen(turn_.norm(), limits_.rotation);
}

bool TimedPose::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration_) {
    reference = goal_;
    return true;
  }
  const double T = duration_;
  const TimeLawPoint p = at(law_, time / T);
  const Vector3 way = goal_.cartesian.position - from_.position;
  const Vector3 v = from_.velocity.head<3>(), w = from_.velocity.tail<3>();
  const Vector3 r = p.s * turn_ + T * p.h * w;
  const auto rates = rotation_rates(r, p.ds / T * turn_ + p.dh * w, p.dds / (T * T) * turn_ + p.ddh / T * w);
  reference.motion = Channels::kPose;
  CartesianReference& pose = reference.cartesian;
  pose.position = from_.position + p.s * way + T * p.h * v;
  pose.orientation = exp(r) * from_.orientation;
  pose.velocity << p.ds / T * way + p.dh * v, rates.velocity;
  pose.acceleration << p.dds / (T * T) * way + p.ddh / T * v, rates.acceleration;
  return false;
}

}  // namespace realtime
