#include "realtime/trajectories/constant_velocity.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/check.hpp"
#include "realtime/joint_range.hpp"
#include "realtime/rotation.hpp"

namespace realtime {
namespace {

constexpr double kDefaultShare = 0.5;  // of the limits of acceleration
constexpr double kLeastRamp = 0.01;    // s: below this the jerk is the limit

template <int N>
double ramp_time(const Eigen::Matrix<double, N, 1>& velocity, const Eigen::Matrix<double, N, 1>& acceleration) {
  return std::max((velocity.cwiseAbs().array() / acceleration.array()).maxCoeff(), kLeastRamp);
}

Vector7 joint_acceleration(const JointVelocity::Parameters& parameters, const models::Limits& limits) {
  Vector7 ddq = kDefaultShare * Vector7::Map(limits.ddq_max.data());
  for (int i = 0; i < models::kJoints; ++i) {
    require_within("dq", i, parameters.dq[i], -limits.dq_max[i], limits.dq_max[i], "rad/s");
    if (parameters.ddq) require_within("ddq", i, ddq[i] = (*parameters.ddq)[i], 1e-3, limits.ddq_max[i], "rad/s²");
  }
  return ddq;
}

Vector6 cartesian_acceleration(const CartesianVelocity::Parameters& parameters, const models::Limits& limits) {
  Vector6 acceleration;
  for (int i = 0; i < 6; ++i) {
    const models::Limits::Rates& most = i < 3 ? limits.translation : limits.rotation;
    require_within("O_dP_EE", i, parameters.O_dP_EE[i], -most.velocity, most.velocity, i < 3 ? "m/s" : "rad/s");
    acceleration[i] = kDefaultShare * most.acceleration;
    if (!parameters.O_ddP_EE) continue;
    acceleration[i] = (*parameters.O_ddP_EE)[i];
    require_within("O_ddP_EE", i, acceleration[i], 1e-3, most.acceleration, i < 3 ? "m/s²" : "rad/s²");
  }
  return acceleration;
}

double checked(double duration) {
  require_within("duration", -1, duration, 0.001, 3600, "s");
  return duration;
}

}  // namespace

Trapezoid::Trapezoid(double duration, double ramp) : duration_(std::max(duration, 2 * ramp)), ramp_(ramp) {}

Trapezoid::Point Trapezoid::at(double t) const {
  t = std::clamp(t, 0.0, duration_);
  if (t < ramp_) return {t * t / (2 * ramp_), t / ramp_, 1 / ramp_};
  const double left = duration_ - t;
  if (left < ramp_) return {duration_ - ramp_ - left * left / (2 * ramp_), left / ramp_, -1 / ramp_};
  return {t - ramp_ / 2, 1, 0};
}

JointVelocity::JointVelocity(const Parameters& parameters, const models::Limits& limits)
    : limits_(limits),
      dq_(parameters.dq),
      asked_duration_(checked(parameters.duration)),
      profile_(asked_duration_, ramp_time<7>(parameters.dq, joint_acceleration(parameters, limits))) {}

void JointVelocity::start(const Reference& from) noexcept {
  from_ = from.joint.q;
  goal_.joint.q = from_ + profile_.at(duration()).way * dq_;
  shortened_ = false;
  for (int i = 0; i < models::kJoints; ++i) {
    const double reachable = std::clamp(goal_.joint.q[i], rest_min(limits_, i), rest_max(limits_, i));
    shortened_ |= dq_[i] != 0 && reachable != goal_.joint.q[i];
  }
}

bool JointVelocity::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration()) {
    reference = goal_;
    return true;
  }
  const auto p = profile_.at(time);
  reference.motion = Channels::kJoint;
  reference.joint.q = from_ + p.way * dq_;
  reference.joint.dq = p.rate * dq_;
  reference.joint.ddq = p.acceleration * dq_;
  return false;
}

CartesianVelocity::CartesianVelocity(const Parameters& parameters, const models::Limits& limits)
    : twist_(parameters.O_dP_EE),
      asked_duration_(checked(parameters.duration)),
      profile_(asked_duration_, ramp_time<6>(parameters.O_dP_EE, cartesian_acceleration(parameters, limits))) {
  goal_.motion = Channels::kPose;
}

void CartesianVelocity::start(const Reference& from) noexcept {
  from_ = from.cartesian;
  const double way = profile_.at(duration()).way;
  goal_.cartesian.position = from_.position + way * twist_.head<3>();
  goal_.cartesian.orientation = exp(way * twist_.tail<3>()) * from_.orientation;
}

bool CartesianVelocity::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration()) {
    reference = goal_;
    return true;
  }
  const auto p = profile_.at(time);
  reference.motion = Channels::kPose;
  CartesianReference& pose = reference.cartesian;
  pose.position = from_.position + p.way * twist_.head<3>();
  pose.orientation = exp(p.way * twist_.tail<3>()) * from_.orientation;
  pose.velocity = p.rate * twist_;
  pose.acceleration = p.acceleration * twist_;
  return false;
}

}  // namespace realtime
