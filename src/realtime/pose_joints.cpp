#include "realtime/pose_joints.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/rotation.hpp"

namespace realtime {
namespace {

// Of the way from the middle of its range to its end, from where on a joint moves the elbow, and at most so fast.
constexpr double kNearEnd = 0.7;
constexpr double kElbowSpeed = 0.2;  // rad/s
constexpr double kElbowGain = 2;     // rad/s

// To a posture, of joint 3: slower, so that the end of a joint's range comes first.
constexpr double kPostureSpeed = 0.1;  // rad/s
constexpr double kPostureGain = 1;     // 1/s, of the way that is left

// Determinants of the Jacobian, 0.037 at home.
constexpr double kNearlySingular = 5e-3, kLeastDeterminant = 1e-3;
constexpr double kFlat = 1e-8;   // 1/rad², of the square of its slope
constexpr double kSlight = 0.3;  // m and rad, by the square of the determinant: so little that is left damps nothing
// m: EE curves so much as a joint turns. Steps that count on a straight way swing about the nearest place where the square of the
// singular value there is less than half of this times what is left, which damps it so much more.
constexpr double kCurve = 0.5;
constexpr double kMet = 0.02;  // of a way, that may be left of it by a step that leads there

}  // namespace

void PoseJoints::place(const Vector7& q) noexcept {
  joints_ = model_.joints_of_pose(q);
  pose_.reset();
  left_.setZero();
}

void PoseJoints::step(const CartesianReference& pose, double dt) noexcept {
  elbow_ = elbow_step(dt);
  const Vector7 step = joints_.dq_dP * change_between(at(joints_.O_T_EE), pose);
  joints_ = model_.joints_of_pose(joints_.q + step + elbow_);
}

void PoseJoints::follow(const CartesianReference& pose, double dt) noexcept {
  if (pose_) left_ = change_between(at(joints_.O_T_EE), *pose_);
  pose_ = pose;
  const double left = left_.norm();
  if (left > kSlight * joints_.determinant * joints_.determinant) {
    joints_ = model_.joints_of_pose(joints_.q, Model::kCalm + kCurve * left);
  }
  const Vector6 way = change_between(at(joints_.O_T_EE), pose);
  const Vector7 step = before_singularity(joints_.dq_dP * way, pose, way.norm());
  elbow_ = elbow_step(dt);
  if (nearer_singularity(elbow_)) elbow_.setZero();
  joints_ = model_.joints_of_pose(joints_.q + step + elbow_);
}

// Whether a step leads from next to a singular posture nearer to it.
bool PoseJoints::nearer_singularity(const Vector7& step) noexcept {
  const double here = joints_.determinant;
  if (std::abs(here) > kNearlySingular) return false;
  return std::copysign(1., here) * (model_.joints_of_pose(joints_.q + step).determinant - here) < 0;
}

// Of a step of the joints what does not lead them into a singular posture, or past it, for a pose that they do not reach: from there
// they could come back another way.
Vector7 PoseJoints::before_singularity(const Vector7& step, const CartesianReference& pose, double way) noexcept {
  const double side = std::copysign(1., joints_.determinant), here = std::abs(joints_.determinant);
  if (here > kNearlySingular) return step;
  const JointsOfPose ahead = model_.joints_of_pose(joints_.q + step);
  const double there = side * ahead.determinant;
  if (there > kLeastDeterminant || there >= here) return step;
  if (change_between(at(ahead.O_T_EE), pose).norm() < kMet * way) return step;
  constexpr double kStep = 1e-4;  // rad
  Vector7 slope;
  for (int i = 0; i < models::kJoints; ++i) {
    slope[i] = (side * model_.joints_of_pose(joints_.q + kStep * Vector7::Unit(i)).determinant - here) / kStep;
  }
  const double least = std::min(kLeastDeterminant - here, 0.);
  return step + std::max(least - slope.dot(step), 0.) / std::max(slope.squaredNorm(), kFlat) * slope;
}

void PoseJoints::leave_elbow() noexcept {
  joints_ = model_.joints_of_pose(joints_.q - elbow_);
  elbow_.setZero();
}

Vector7 PoseJoints::elbow_step(double dt) const noexcept {
  const Vector7& n = joints_.null_motion;
  double to_posture = 0, room = 1;
  if (posture_) {
    const double way = n.dot(*posture_ - joints_.q) / n.squaredNorm();
    to_posture = std::clamp(kPostureGain * way, -kPostureSpeed, kPostureSpeed);
  }
  double push = 0;
  for (int i = 0; i < models::kJoints; ++i) {
    const double half = (limits_.q_max[i] - limits_.q_min[i]) / 2;
    const double x = (joints_.q[i] - limits_.q_min[i]) / half - 1;
    const double near = std::clamp((std::abs(x) - kNearEnd) / (1 - kNearEnd), 0., 1.);
    push -= std::copysign(near * near, x) * n[i] / half;
    if (to_posture * n[i] * x > 0) room = std::min(room, 1 - near);
  }
  return dt * std::clamp(kElbowGain * push + room * to_posture, -kElbowSpeed, kElbowSpeed) * n;
}

}  // namespace realtime
