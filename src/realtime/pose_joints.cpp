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

}  // namespace

void PoseJoints::step(const CartesianReference& pose, double dt) noexcept {
  joints_ = model_.joints_of_pose(joints_.q);
  joints_.q += joints_.dq_dP * change_between(at(joints_.O_T_EE), pose);
  joints_.q += dt * elbow_speed() * joints_.null_motion;
}

double PoseJoints::elbow_speed() const noexcept {
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
  return std::clamp(kElbowGain * push + room * to_posture, -kElbowSpeed, kElbowSpeed);
}

}  // namespace realtime
