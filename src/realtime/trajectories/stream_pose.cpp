#include "realtime/trajectories/stream_pose.hpp"

#include <limits>
#include <numbers>

#include "realtime/check.hpp"
#include "realtime/rotation.hpp"
#include "realtime/trajectories/pose_rates.hpp"
#include "realtime/trajectories/target_stream.hpp"

namespace realtime {
namespace {

// Where position and quaternion are in the numbers of each message that it takes.
const std::vector<std::string> kPoseMessages = {"PosePositionSensorMessage", "PosePositionVelocitySensorMessage", "PoseChunk"};
constexpr int kPositionAt[] = {2, 3, 0};

// Of the rotation vectors of one orientation the one that is nearest to another.
Vector3 nearest(const Vector3& r, const Vector3& to) {
  const double angle = r.norm();
  if (angle < 1e-6) return r;
  const Vector3 axis = r / angle;
  const double turns = std::round((to.dot(axis) - angle) / (2 * std::numbers::pi));
  return axis * (angle + 2 * std::numbers::pi * turns);
}

}  // namespace

StreamPose::StreamPose(const Parameters& parameters, const models::Limits& limits)
    : StreamPose(parameters, limits,
                 std::make_shared<SensorInput>(require_topic(parameters.topic), kPoseMessages,
                                               parameters.timeout.value_or(TargetStream<6>::kTimeout))) {}

StreamPose::StreamPose(const Parameters& parameters, const models::Limits& limits, std::shared_ptr<SensorInput> input)
    : Stream(std::move(input)),
      stream_(std::make_unique<TargetStream<6>>(parameters.delay, parameters.timeout, pose_rates(limits, parameters.speed))) {}

StreamPose::~StreamPose() = default;

void StreamPose::start(const Reference& from) noexcept {
  Stream::start(from);
  turn_.setZero();
  const CartesianReference& pose = from.cartesian;
  TargetStream<6>::Point point;
  point.x << pose.position, Vector3::Zero();
  point.v = pose.velocity;
  point.a = pose.acceleration;
  stream_->start(point);
}

void StreamPose::take(double time, const SensorSample& sample) noexcept {
  const double* values = sample.values.data() + kPositionAt[sample.message];
  add(time, sample, Vector3::Map(values), {values[3], values[4], values[5], values[6]});
}

void StreamPose::add(double time, const SensorSample& sample, const Vector3& position,
                     const Eigen::Quaterniond& orientation) noexcept {
  turn_ = nearest(log(orientation.normalized() * goal().cartesian.orientation.conjugate()), turn_);
  Vector6 x;
  x << position, turn_;
  const double sent = sample.sent_ns != 0 ? 1e-9 * static_cast<double>(sample.sent_ns)
                                          : std::numeric_limits<double>::quiet_NaN();
  stream_->add(time - sample.waited, {x, sent, sample.lead, sample.replaces});
}

bool StreamPose::step(const Cycle& cycle, double time, Reference& reference) noexcept {
  for (SensorSample sample; input_->take(sample);) take(time, sample);
  const auto point = stream_->at(time, cycle.time);
  const Vector3 r = point.x.tail<3>();
  const auto rates = rotation_rates(r, point.v.tail<3>(), point.a.tail<3>());
  reference.motion = Channels::kPose;
  CartesianReference& pose = reference.cartesian;
  pose.position = point.x.head<3>();
  pose.orientation = (exp(r) * goal().cartesian.orientation).normalized();
  pose.velocity << point.v.head<3>(), rates.velocity;
  pose.acceleration << point.a.head<3>(), rates.acceleration;
  return false;
}

bool StreamPose::limited() const noexcept { return stream_->limited(); }

}  // namespace realtime
