#include "realtime/trajectories/min_jerk_pose.hpp"

#include "realtime/check.hpp"
#include "realtime/rotation.hpp"
#include "realtime/trajectories/pose_difference.hpp"

namespace realtime {

MinJerkPose::MinJerkPose(double duration, const models::Limits& limits) : limits_(limits), asked_duration_(duration) {
  goal_.motion = Channels::kPose;
  require_within("duration", -1, duration, 0.001, 3600, "s");
}

MinJerkPose::MinJerkPose(const Parameters& parameters, const models::Limits& limits)
    : MinJerkPose(parameters.duration, limits) {
  for (int i = 0; i < 3; ++i) require_within("position", i, parameters.position[i], -2, 2, "m");
  goal_.cartesian.position = parameters.position;
  goal_.cartesian.orientation = require_rotation("quaternion", parameters.orientation);
}

void MinJerkPose::set_duration(double T) noexcept {
  translation_.set_duration(T);
  rotation_.set_duration(T);
}

void MinJerkPose::start(const Reference& from) noexcept {
  const CartesianReference& pose = from.cartesian;
  const auto decay = [](const Vector6& velocity, const Vector6& acceleration, int first,
                        const models::Limits::Rates& limits) {
    return decay_duration(velocity.segment<3>(first).norm(), acceleration.segment<3>(first).norm(), limits);
  };
  const double together = std::max(decay(pose.velocity, pose.acceleration, 0, limits_.translation),
                                   decay(pose.velocity, pose.acceleration, 3, limits_.rotation));
  translation_.start(pose.position, pose.velocity.head<3>(), pose.acceleration.head<3>(), goal_.cartesian.position,
                     together);
  const Vector3 r = log(pose.orientation.normalized() * goal_.cartesian.orientation.conjugate());
  const auto rates = rotation_vector_rates(r, pose.velocity.tail<3>(), pose.acceleration.tail<3>());
  rotation_.start(r, rates.dr, rates.ddr, Vector3::Zero(), together);

  double T = std::max({asked_duration_, least_duration(translation_.way().norm(), limits_.translation),
                       least_duration(rotation_.way().norm(), limits_.rotation)});
  set_duration(T);
  if (translation_.moving() || rotation_.moving()) {
    const auto raise_by = [](double& worst, const Vector3& v, const Vector3& a, const Vector3& j,
                             const Vector3& v_timed, const models::Limits::Rates& limits) {
      // What it begins with, no duration mends.
      if (v_timed.norm() < 0.01 * limits.velocity || (v - v_timed).norm() > 0.9 * limits.velocity) return;
      raise(worst, v.norm() / (kMotionShare * limits.velocity), a.norm() / (kMotionShare * limits.acceleration),
            j.norm() / (kMotionShare * limits.jerk));
    };
    realtime::stretch(
        T,
        [&](double duration) {
          set_duration(duration);
          return this->duration();
        },
        [&](double t, double& worst) {
          const auto x = translation_.at(t);
          raise_by(worst, x.v, x.a, x.j, x.v_timed, limits_.translation);
          const auto r = rotation_.at(t);
          const auto rates = rotation_rates(r.x, r.v, r.a);
          raise_by(worst, rates.velocity, rates.acceleration, r.j, r.v_timed, limits_.rotation);
        });
  }
  stretch_ = T / asked_duration_;
}

bool MinJerkPose::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration()) {
    reference = goal_;
    return true;
  }
  const auto x = translation_.at(time);
  const auto r = rotation_.at(time);
  const auto rates = rotation_rates(r.x, r.v, r.a);
  reference.motion = Channels::kPose;
  CartesianReference& pose = reference.cartesian;
  pose.position = x.x;
  pose.orientation = exp(r.x) * goal_.cartesian.orientation;
  pose.velocity << x.v, rates.velocity;
  pose.acceleration << x.a, rates.acceleration;
  return false;
}

}  // namespace realtime
