#include "realtime/trajectories/pose_path.hpp"

#include <stdexcept>
#include <string>

#include "realtime/rotation.hpp"

namespace realtime {

void PosePath::start(const Reference& from) noexcept {
  const CartesianReference path = at(0), &pose = from.cartesian;
  const Vector3 x = pose.position - path.position, r = log(pose.orientation * path.orientation.conjugate());
  const Vector3 v = pose.velocity.head<3>() - path.velocity.head<3>();
  const Vector3 a = pose.acceleration.head<3>() - path.acceleration.head<3>();
  // w = w_r + exp(r) w_path, and that differentiated
  const Eigen::Quaterniond turn = exp(r);
  const Vector3 carried = turn * Vector3(path.velocity.tail<3>());
  const Vector3 w = pose.velocity.tail<3>() - carried;
  const Vector3 dw = pose.acceleration.tail<3>() - turn * Vector3(path.acceleration.tail<3>()) - w.cross(carried);
  const auto r_rates = rotation_vector_rates(r, w, dw);

  const double decay = std::max(decay_duration(v.norm(), a.norm(), limits_.translation),
                                decay_duration(w.norm(), dw.norm(), limits_.rotation));
  translation_.start(x, v, a, Vector3::Zero(), decay);
  rotation_.start(r, r_rates.dr, r_rates.ddr, Vector3::Zero(), decay);
  const double T = std::max({decay, fade_duration(translation_.way().norm(), limits_.translation),
                             fade_duration(rotation_.way().norm(), limits_.rotation)});
  for (MinJerk<3>* each : {&translation_, &rotation_})
    each->set_duration(T);
  wait_ = std::max(0.0, T - clear_after_);
}

bool PosePath::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration()) {
    reference = goal_;
    return true;
  }
  reference.motion = Channels::kPose;
  CartesianReference& pose = reference.cartesian;
  pose = at(std::clamp(time - wait_, 0.0, length_));
  if (time < wait_ || time > wait_ + length_) {
    pose.velocity.setZero();
    pose.acceleration.setZero();
  }
  const auto x = translation_.at(time), r = rotation_.at(time);
  const auto r_rates = rotation_rates(r.x, r.v, r.a);
  const Eigen::Quaterniond turn = exp(r.x);
  const Vector3 carried = turn * Vector3(pose.velocity.tail<3>());
  pose.position += x.x;
  pose.orientation = turn * pose.orientation;
  pose.velocity.head<3>() += x.v;
  pose.velocity.tail<3>() = carried + r_rates.velocity;
  pose.acceleration.head<3>() += x.a;
  pose.acceleration.tail<3>() =
      turn * Vector3(pose.acceleration.tail<3>()) + r_rates.acceleration + r_rates.velocity.cross(carried);
  return false;
}

void require_same_size(std::size_t positions, std::size_t quaternions) {
  if (positions == quaternions && positions > 0) return;
  throw std::invalid_argument("there are " + std::to_string(positions) + " positions and " +
                              std::to_string(quaternions) + " quaternions: expected one of each for every pose");
}

Vector7 coordinates(const Vector3& position, const Eigen::Quaterniond& orientation) noexcept {
  Vector7 x;
  x << position, orientation.w(), orientation.vec();
  return x;
}

Vector7 nearer(const Vector7& coordinates, const Vector7& to) noexcept {
  Vector7 x = coordinates;
  if (x.tail<4>().dot(to.tail<4>()) < 0) x.tail<4>() *= -1;
  return x;
}

CartesianReference pose_of(const Vector7& x, const Vector7& v, const Vector7& a) noexcept {
  const auto quaternion = [](const Vector7& each) { return Eigen::Quaterniond(each[3], each[4], each[5], each[6]); };
  const Eigen::Quaterniond Q = quaternion(x), back = Q.conjugate();
  const double norm = x.tail<4>().squaredNorm();
  const Vector3 w = 2 / norm * (quaternion(v) * back).vec();
  const Vector3 dw = 2 / norm * (quaternion(a) * back).vec() - 2 / norm * x.tail<4>().dot(v.tail<4>()) * w;
  CartesianReference pose;
  pose.position = x.head<3>();
  pose.orientation = Q.normalized();
  pose.velocity << v.head<3>(), w;
  pose.acceleration << a.head<3>(), dw;
  return pose;
}

}  // namespace realtime
