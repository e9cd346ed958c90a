#include "realtime/trajectories/stream_force_position.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>

#include "realtime/check.hpp"
#include "realtime/trajectories/target_stream.hpp"

namespace realtime {
namespace {

constexpr int kPoseAt = 3, kForceAt = 19;  // in the numbers of ForcePositionSensorMessage
constexpr double kRise = 0.05;             // s
constexpr double kMostTorque = 50;         // N m, as of LinearForcePosition
constexpr double kOrthonormal = 1e-3;

Eigen::Isometry3d pose_of(const SensorSample& sample) {
  return Eigen::Isometry3d(Eigen::Map<const Eigen::Matrix4d>(sample.values.data() + kPoseAt));
}

std::string check(const SensorSample& sample) {
  const Eigen::Isometry3d pose = pose_of(sample);
  const Eigen::Matrix3d R = pose.linear();
  if (!(R.transpose() * R).isIdentity(kOrthonormal) || R.determinant() < 0 ||
      pose.matrix().row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
    return "pose is no homogeneous transform: expected a rotation, a translation, and 0, 0, 0, 1 as its last row, by columns";
  }
  for (int i = 3; i < 6; ++i) {
    if (const double torque = sample.values[kForceAt + i]; std::abs(torque) > kMostTorque) {
      return "force[" + std::to_string(i) + "] is " + std::to_string(torque) + " N m: expected -50 to 50";
    }
  }
  return "";
}

}  // namespace

StreamForcePosition::StreamForcePosition(const Parameters& parameters, const models::Limits& limits)
    : StreamPose(parameters, limits,
                 std::make_shared<SensorInput>(require_topic(parameters.topic),
                                               std::vector<std::string>{"ForcePositionSensorMessage"},
                                               parameters.timeout.value_or(TargetStream<6>::kTimeout), check)),
      timeout_(input_->timeout()) {}

void StreamForcePosition::start(const Reference& from) noexcept {
  StreamPose::start(from);
  wrench_ = wanted_ = from.wrench;
  last_ = reached_ = 0;
  heard_.reset();
}

void StreamForcePosition::take(double time, const SensorSample& sample) noexcept {
  const Eigen::Isometry3d pose = pose_of(sample);
  add(time, sample, pose.translation(), Eigen::Quaterniond(pose.linear()));
  wanted_ = Vector6::Map(sample.values.data() + kForceAt);
  reached_ = last_ + kRise;
  heard_.reset();
}

bool StreamForcePosition::step(const Cycle& cycle, double time, Reference& reference) noexcept {
  StreamPose::step(cycle, time, reference);
  if (!heard_) heard_ = cycle.time;
  if (timeout_ > 0 && cycle.time - *heard_ > timeout_ && !wanted_.isZero(0)) {
    wanted_.setZero();
    reached_ = last_ + kRise;
  }
  const double share = time < reached_ ? (time - last_) / (reached_ - last_) : 1;
  wrench_ += std::clamp(share, 0.0, 1.0) * (wanted_ - wrench_);
  last_ = time;
  reference.wrench = wrench_;
  return false;
}

}  // namespace realtime
