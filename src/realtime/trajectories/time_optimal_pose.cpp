#include "realtime/trajectories/time_optimal_pose.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/check.hpp"
#include "realtime/rotation.hpp"
#include "realtime/ruckig_planner.hpp"
#include "realtime/trajectories/min_jerk.hpp"
#include "realtime/trajectories/pose_difference.hpp"

namespace realtime {
namespace {

constexpr int kAxes = 6;

}  // namespace

struct TimeOptimalPose::Planner : RuckigPlanner<kAxes> {};

TimeOptimalPose::TimeOptimalPose(const Parameters& parameters, const models::Limits& limits)
    : planner_(std::make_unique<Planner>()) {
  require_within("speed", -1, parameters.speed, 0.01, 1, "of the limits");
  goal_.motion = Channels::kPose;
  for (int i = 0; i < 3; ++i) require_within("position", i, parameters.position[i], -2, 2, "m");
  goal_.cartesian.position = parameters.position;
  goal_.cartesian.orientation = require_rotation("quaternion", parameters.orientation);
  auto& in = planner_->in;
  in.synchronization = ruckig::Synchronization::Phase;
  const double share = kMotionShare * parameters.speed / std::sqrt(3.0);
  for (int i = 0; i < kAxes; ++i) {
    const models::Limits::Rates& most = i < 3 ? limits.translation : limits.rotation;
    in.max_velocity[i] = share * most.velocity;
    in.max_acceleration[i] = share * most.acceleration;
    in.max_jerk[i] = share * most.jerk;
    in.target_position[i] = i < 3 ? parameters.position[i] : 0;
    in.target_velocity[i] = in.target_acceleration[i] = 0;
  }
}

TimeOptimalPose::~TimeOptimalPose() = default;

void TimeOptimalPose::start(const Reference& from) noexcept {
  const CartesianReference& pose = from.cartesian;
  const Vector3 r = log(pose.orientation * goal_.cartesian.orientation.conjugate());
  const auto rates = rotation_vector_rates(r, pose.velocity.tail<3>(), pose.acceleration.tail<3>());
  auto& in = planner_->in;
  for (int i = 0; i < 3; ++i) {
    in.current_position[i] = pose.position[i];
    in.current_velocity[i] = pose.velocity[i];
    in.current_acceleration[i] = pose.acceleration[i];
    in.current_position[3 + i] = r[i];
    in.current_velocity[3 + i] = rates.dr[i];
    in.current_acceleration[3 + i] = rates.ddr[i];
  }
  const bool planned = planner_->plan();
  duration_ = planned ? planner_->trajectory.get_duration() : 0;  // else the limiter makes one
}

bool TimeOptimalPose::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration_) {
    reference = goal_;
    return true;
  }
  std::array<double, kAxes> x, v, a;
  planner_->trajectory.at_time(std::max(time, 0.0), x, v, a);
  const Vector3 r = Vector3::Map(x.data() + 3);
  const auto rates = rotation_rates(r, Vector3::Map(v.data() + 3), Vector3::Map(a.data() + 3));
  reference.motion = Channels::kPose;
  CartesianReference& pose = reference.cartesian;
  pose.position = Vector3::Map(x.data());
  pose.orientation = exp(r) * goal_.cartesian.orientation;
  pose.velocity << Vector3::Map(v.data()), rates.velocity;
  pose.acceleration << Vector3::Map(a.data()), rates.acceleration;
  return false;
}

}  // namespace realtime
