#include "realtime/trajectories/pose_dmp.hpp"

#include <Eigen/Geometry>

namespace realtime {
namespace {

using Dimensions = PoseDmp::Dimensions;

constexpr double kSingular = 0.05;  // cos of the middle angle

template <int M>
DmpSensors<6> rollout(FirstBasis first, const PoseDmp::Parameters& parameters, int from) {
  require_within("duration", -1, parameters.duration, 0.001, 120, "s");
  const DmpForcing<M> forcing("", parameters.force, first, true);
  const double tau = parameters.spring.tau;
  return {"", parameters.spring, parameters.duration, forcing, from, parameters.force.topic, true, [&](int sensor) {
            return [&, sensor](double t) {
              Vector6 f = Vector6::Zero();
              f.segment<M>(from) = forcing.at(std::exp(-tau * t), 2 * tau * t, sensor);
              return f;
            };
          }};
}

DmpSensors<6> rollout(FirstBasis first, const PoseDmp::Parameters& parameters) {
  if (parameters.dimensions == Dimensions::kAll) return rollout<6>(first, parameters, 0);
  return rollout<3>(first, parameters, parameters.dimensions == Dimensions::kPosition ? 0 : 3);
}

// --- Euler angles e of R = Rx(e0) Ry(e1) Rz(e2): w = E de, the columns of E being the axes that they turn about ------

Eigen::Quaterniond rotation(const Vector3& e) {
  return Eigen::AngleAxisd(e[0], Vector3::UnitX()) * Eigen::AngleAxisd(e[1], Vector3::UnitY()) *
         Eigen::AngleAxisd(e[2], Vector3::UnitZ());
}

Vector3 angles(const Eigen::Quaterniond& q) {
  const Eigen::Matrix3d R = q.toRotationMatrix();
  const double cosine = std::hypot(R(0, 0), R(0, 1));
  if (cosine > 1e-9) return {std::atan2(-R(1, 2), R(2, 2)), std::atan2(R(0, 2), cosine), std::atan2(-R(0, 1), R(0, 0))};
  return {std::atan2(R(2, 1), R(1, 1)), std::atan2(R(0, 2), cosine), 0};
}

Eigen::Matrix3d axes(const Vector3& e) {
  const double sa = std::sin(e[0]), ca = std::cos(e[0]), sb = std::sin(e[1]), cb = std::cos(e[1]);
  Eigen::Matrix3d E;
  E << 1, 0, sb, 0, ca, -sa * cb, 0, sa, ca * cb;
  return E;
}

// The turning of the axes, times de: the second carried along by the first, the third by both.
Vector3 axes_change(const Eigen::Matrix3d& E, const Vector3& de) {
  return de[0] * de[1] * E.col(0).cross(E.col(1)) + de[2] * (de[0] * E.col(0) + de[1] * E.col(1)).cross(E.col(2));
}

// Bounds of |E v| and of the product above, whatever the angles are.
double turning(const Vector3& v) { return std::hypot(v[1], std::abs(v[0]) + std::abs(v[2])); }
double carried(const Vector3& v) {
  const Vector3 w = v.cwiseAbs();
  return w[0] * w[1] + w[0] * w[2] + w[1] * w[2];
}

}  // namespace

PoseDmp::PoseDmp(FirstBasis first, const Parameters& parameters, const models::Limits& limits)
    : limits_(limits), ee_frame_(parameters.ee_frame), rollout_(rollout(first, parameters)) {
  goal_.motion = Channels::kPose;
  visit_rates(rollout_, [&](const auto& v, const auto& a, const Vector6& j) {
    const Vector3 de = v.forced.template tail<3>();
    slower_ = std::max({slower_,
                        slower(v.forced.template head<3>().norm(), a.forced.template head<3>().norm(),
                               j.template head<3>().norm(), limits_.translation),
                        slower(turning(de), turning(a.forced.template tail<3>()) + carried(de),
                               turning(j.template tail<3>()), limits_.rotation)});
  });
}

void PoseDmp::start(const Reference& from) noexcept {
  const CartesianReference& pose = from.cartesian;
  from_ = pose.position;
  if (ee_frame_) axes_ = pose.orientation.toRotationMatrix();
  Vector6 base, dy0;
  base << Vector3::Zero(), angles(pose.orientation);
  Vector3 de = Vector3::Zero();
  if (std::abs(std::cos(base[4])) > kSingular) de = axes(base.tail<3>()).inverse() * pose.velocity.tail<3>();
  dy0 << axes_.transpose() * pose.velocity.head<3>(), de;
  rollout_.start();
  motion_.start(rollout_, base, Vector6::Zero(), dy0, slower_);
  const auto end = motion_.at_cut();
  const double decay =
      std::max(decay_duration(end.dy.head<3>().norm(), end.ddy.head<3>().norm(), limits_.translation),
               decay_duration(turning(end.dy.tail<3>()), turning(end.ddy.tail<3>()), limits_.rotation));
  place(motion_.come_to_rest(decay), goal_.cartesian);
}

bool PoseDmp::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration()) {
    reference = goal_;
    return true;
  }
  if (time < motion_.cut() && rollout_.take(motion_.clock(time))) place(motion_.come_to_rest(), goal_.cartesian);
  const auto point = motion_.at(time);
  reference.motion = Channels::kPose;
  CartesianReference& pose = reference.cartesian;
  place(point.y, pose);
  const Eigen::Matrix3d E = axes(point.y.tail<3>());
  const Vector3 de = point.dy.tail<3>(), dde = point.ddy.tail<3>();
  pose.velocity << axes_ * point.dy.head<3>(), E * de;
  pose.acceleration << axes_ * point.ddy.head<3>(), E * dde + axes_change(E, de);
  return false;
}

void PoseDmp::place(const Vector6& y, CartesianReference& pose) const noexcept {
  pose.position = from_ + axes_ * y.head<3>();
  pose.orientation = rotation(y.tail<3>());
}

}  // namespace realtime
