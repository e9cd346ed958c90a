#include "realtime/trajectories/quaternion_pose_dmp.hpp"

#include "realtime/rotation.hpp"
#include "realtime/trajectories/pose_difference.hpp"

namespace realtime {
namespace {

using Parameters = QuaternionPoseDmp::Parameters;

constexpr int kSamples = 200;  // of a rollout

DmpSensors<3> translation(const Parameters& parameters) {
  require_within("duration", -1, parameters.duration, 0.001, 120, "s");
  const DmpForcing<3> forcing("position_", parameters.position_force, FirstBasis::kMinJerk, true);
  const double tau = parameters.position_spring.tau;
  return {"position_", parameters.position_spring, parameters.duration, forcing, 0, parameters.position_force.topic, true,
          [&](int sensor) { return [&, sensor](double t) { return forcing.at(std::exp(-tau * t), 2 * tau * t, sensor); }; }};
}

// In the form of all others: tau = 1/T, and a force that is not multiplied by alpha beta.
DmpRollout<3> rotation(const Parameters& parameters) {
  const double T = parameters.goal_time;
  require_within("goal_quat_time", -1, T, 0.001, 120, "s");
  const DmpForcing<3> forcing("quat_", parameters.force, FirstBasis::kGaussian, true);
  const double scale = 1 / (parameters.alpha * parameters.beta);
  return {"quat_", {1 / T, parameters.alpha, parameters.beta}, parameters.duration, [&](double t) {
            return t <= T ? Vector3(scale * forcing.at(std::exp(-t / T), 0)) : Vector3(Vector3::Zero());
          }};
}

}  // namespace

QuaternionPoseDmp::QuaternionPoseDmp(const Parameters& parameters, const models::Limits& limits)
    : limits_(limits),
      ee_frame_(parameters.ee_frame),
      goal_orientation_(require_rotation("goal_quat", parameters.goal)),
      translation_rollout_(translation(parameters)),
      rotation_rollout_(rotation(parameters)) {
  goal_.motion = Channels::kPose;
  visit_rates(translation_rollout_, [&](const auto& v, const auto& a, const Vector3& j) {
    translation_slower_ =
        std::max(translation_slower_, slower(v.forced.norm(), a.forced.norm(), j.norm(), limits_.translation));
  });
}

void QuaternionPoseDmp::start(const Reference& from) noexcept {
  const CartesianReference& pose = from.cartesian;
  from_ = pose.position;
  if (ee_frame_) axes_ = pose.orientation.toRotationMatrix();
  const Vector3 r = log(pose.orientation * goal_orientation_.conjugate());
  const Vector3 dr = rotation_vector_rates(r, pose.velocity.tail<3>(), Vector3::Zero()).dr;
  // At samples, as this is in the loop: what was learned mostly holds the spring back that pulls from the start.
  double most_v = 0, most_a = 0;
  for (int k = 0; k <= kSamples; ++k) {
    const auto rates = rotation_rollout_.at(rotation_rollout_.duration() * k / kSamples);
    most_v = std::max(most_v, (rates.v.forced + rates.v.from_position * r).norm());  // w is no faster than r'
    most_a = std::max(most_a, (rates.a.forced + rates.a.from_position * r).norm());
  }
  slower_ = std::max(translation_slower_, slower(most_v, most_a, 0, limits_.rotation));
  translation_rollout_.start();
  translation_.start(translation_rollout_, Vector3::Zero(), Vector3::Zero(),
                     axes_.transpose() * pose.velocity.head<3>(), slower_);
  rotation_.start(rotation_rollout_, Vector3::Zero(), r, dr, slower_);
  const auto x_end = translation_.at_cut();
  const auto r_end = rotation_.at_cut();
  const double decay = std::max(decay_duration(x_end.dy.norm(), x_end.ddy.norm(), limits_.translation),
                                decay_duration(r_end.dy.norm(), r_end.ddy.norm(), limits_.rotation));
  goal_.cartesian.position = from_ + axes_ * translation_.come_to_rest(decay);
  goal_.cartesian.orientation = exp(rotation_.come_to_rest(decay)) * goal_orientation_;
}

bool QuaternionPoseDmp::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration()) {
    reference = goal_;
    return true;
  }
  if (time < translation_.cut() && translation_rollout_.take(translation_.clock(time))) {
    goal_.cartesian.position = from_ + axes_ * translation_.come_to_rest();
  }
  const auto x = translation_.at(time);
  const auto r = rotation_.at(time);
  const auto rates = rotation_rates(r.y, r.dy, r.ddy);
  reference.motion = Channels::kPose;
  CartesianReference& pose = reference.cartesian;
  pose.position = from_ + axes_ * x.y;
  pose.orientation = exp(r.y) * goal_orientation_;
  pose.velocity << axes_ * x.dy, rates.velocity;
  pose.acceleration << axes_ * x.ddy, rates.acceleration;
  return false;
}

}  // namespace realtime
