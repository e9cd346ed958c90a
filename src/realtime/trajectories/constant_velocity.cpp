#include "realtime/trajectories/constant_velocity.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/check.hpp"
#include "realtime/joint_range.hpp"
#include "realtime/rotation.hpp"

namespace realtime {
namespace {

constexpr double kDefaultShare = 0.5;  // of the limits of acceleration
// Of the limits of jerk: as much as the limiter uses to catch up, for the sake of commands that are lost. A motion that begins
// faster than that has to be caught up with, beyond its velocity.
constexpr double kJerkShare = 0.05;
constexpr double kLeastRamp = 0.001;  // s

// The greatest |v_i| / most_i.
template <int N>
double greatest(const Eigen::Matrix<double, N, 1>& velocity, const Eigen::Matrix<double, N, 1>& most) {
  return (velocity.cwiseAbs().array() / most.array()).maxCoeff();
}

// `by_acceleration`, s, and `by_jerk`, s²: the greatest quotients of velocity.
Trapezoid profile(double duration, double by_acceleration, double by_jerk) {
  const double c = std::max({by_acceleration, std::sqrt(by_jerk), kLeastRamp});
  return {duration, c, by_jerk / c};
}

Vector7 joint_jerk(const models::Limits& limits) { return kJerkShare * Vector7::Map(limits.dddq_max.data()); }

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

Vector6 cartesian_jerk(const models::Limits& limits) {
  Vector6 jerk;
  jerk << Vector3::Constant(limits.translation.jerk), Vector3::Constant(limits.rotation.jerk);
  return kJerkShare * jerk;
}

// The joints at `dq`, where the motion begins, are kept to a share too, but not against an acceleration that is given.
Trapezoid cartesian_profile(double duration, const CartesianVelocity::Parameters& parameters, Vector7 dq,
                            const models::Limits& limits) {
  dq /= std::max(greatest<7>(dq, Vector7::Map(limits.dq_max.data())), 1.);  // those that are too fast are slowed on their way
  const Vector6& twist = parameters.O_dP_EE;
  double by_acceleration = greatest<6>(twist, cartesian_acceleration(parameters, limits));
  double by_jerk = greatest<6>(twist, cartesian_jerk(limits));
  if (!parameters.O_ddP_EE) {
    by_acceleration = std::max(by_acceleration, greatest<7>(dq, kDefaultShare * Vector7::Map(limits.ddq_max.data())));
    by_jerk = std::max(by_jerk, greatest<7>(dq, joint_jerk(limits)));
  }
  return profile(duration, by_acceleration, by_jerk);
}

double checked(double duration) {
  require_within("duration", -1, duration, 0.001, 3600, "s");
  return duration;
}

}  // namespace

Trapezoid::Trapezoid(double duration, double c, double r) : c_(c), r_(r), duration_(std::max(duration, 2 * (c + r))) {}

Trapezoid::Point Trapezoid::at(double t) const {
  t = std::clamp(t, 0.0, duration_);
  const double ramp = c_ + r_, left = duration_ - t;
  if (t < ramp) return begin(t);
  if (left >= ramp) return {t - ramp / 2, 1, 0};
  const Point mirrored = begin(left);
  return {duration_ - ramp - mirrored.way, mirrored.rate, -mirrored.acceleration};
}

Trapezoid::Point Trapezoid::begin(double t) const {
  if (t < r_) return {t * t * t / (6 * c_ * r_), t * t / (2 * c_ * r_), t / (c_ * r_)};
  if (t <= c_) {
    const double from_middle = t - r_ / 2;
    return {(from_middle * from_middle + r_ * r_ / 12) / (2 * c_), from_middle / c_, 1 / c_};
  }
  const double left = c_ + r_ - t;
  return {t - (c_ + r_) / 2 + left * left * left / (6 * c_ * r_), 1 - left * left / (2 * c_ * r_), left / (c_ * r_)};
}

JointVelocity::JointVelocity(const Parameters& parameters, const models::Limits& limits)
    : limits_(limits),
      dq_(parameters.dq),
      asked_duration_(checked(parameters.duration)),
      profile_(profile(asked_duration_, greatest<7>(parameters.dq, joint_acceleration(parameters, limits)),
                       greatest<7>(parameters.dq, joint_jerk(limits)))) {}

void JointVelocity::start(const Reference& from) noexcept {
  from_ = from.joint.q;
  goal_.joint.q = from_ + profile_.at(duration()).way * dq_;
  shortened_ = false;
  for (int i = 0; i < models::kJoints; ++i) {
    const double reachable = std::clamp(goal_.joint.q[i], rest_min(limits_, i), rest_max(limits_, i));
    if (dq_[i] == 0) continue;
    shortened_ |= reachable != goal_.joint.q[i];
    goal_.joint.q[i] = reachable;
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

CartesianVelocity::CartesianVelocity(const Parameters& parameters, const models::Limits& limits, const Vector7& dq)
    : twist_(parameters.O_dP_EE),
      asked_duration_(checked(parameters.duration)),
      profile_(cartesian_profile(asked_duration_, parameters, dq, limits)) {
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
