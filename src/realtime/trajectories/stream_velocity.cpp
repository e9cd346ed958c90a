#include "realtime/trajectories/stream_velocity.hpp"

#include "realtime/check.hpp"
#include "realtime/joint_range.hpp"
#include "realtime/rotation.hpp"
#include "realtime/trajectories/joint_rates.hpp"
#include "realtime/trajectories/pose_rates.hpp"
#include "realtime/trajectories/velocity_stream.hpp"

namespace realtime {
namespace {

constexpr int kVelocityAt = 2;  // in the numbers of either message

}  // namespace

StreamJointVelocity::StreamJointVelocity(const Parameters& parameters, const models::Limits& limits)
    : Stream(std::make_shared<SensorInput>(require_topic(parameters.topic),
                                           std::vector<std::string>{"JointVelocitySensorMessage"}, parameters.timeout)),
      stream_(std::make_unique<VelocityStream<models::kJoints>>(parameters.timeout, joint_rates(limits, parameters.speed))) {
  for (int i = 0; i < models::kJoints; ++i) {
    rest_min_[i] = rest_min(limits, i);
    rest_max_[i] = rest_max(limits, i);
  }
}

StreamJointVelocity::~StreamJointVelocity() = default;

void StreamJointVelocity::start(const Reference& from) noexcept {
  Stream::start(from);
  stream_->start({from.joint.q, from.joint.dq, from.joint.ddq});
  // One that begins beyond them stays there until it is asked back.
  q_min_ = rest_min_.cwiseMin(from.joint.q);
  q_max_ = rest_max_.cwiseMax(from.joint.q);
}

void StreamJointVelocity::held_back(const Reference& reference) noexcept {
  const auto& point = stream_->point();
  const Vector7 most = stream_->kAhead * point.v.cwiseAbs();
  stream_->move_to(point.x.cwiseMax(reference.joint.q - most).cwiseMin(reference.joint.q + most));
}

bool StreamJointVelocity::step(const Cycle& cycle, double time, Reference& reference) noexcept {
  auto point = stream_->at(time, cycle.time);
  const Vector7 inside = point.x.cwiseMax(q_min_).cwiseMin(q_max_);
  at_end_ = inside != point.x;
  if (at_end_) {  // what goes on beyond a limit would have to come back first
    stream_->move_to(inside);
    for (int i = 0; i < models::kJoints; ++i) {
      if (inside[i] != point.x[i]) point.v[i] = point.a[i] = 0;
    }
    point.x = inside;
  }
  if (SensorSample sample; input_->newest(sample)) stream_->add(Vector7::Map(sample.values.data() + kVelocityAt));
  reference.motion = Channels::kJoint;
  reference.joint = {point.x, point.v, point.a};
  return false;
}

bool StreamJointVelocity::limited() const noexcept { return at_end_ || stream_->limited(); }

StreamCartesianVelocity::StreamCartesianVelocity(const Parameters& parameters, const models::Limits& limits)
    : Stream(std::make_shared<SensorInput>(require_topic(parameters.topic),
                                           std::vector<std::string>{"CartesianVelocitySensorMessage"}, parameters.timeout)),
      stream_(std::make_unique<VelocityStream<6>>(parameters.timeout, pose_rates(limits, parameters.speed))) {}

StreamCartesianVelocity::~StreamCartesianVelocity() = default;

void StreamCartesianVelocity::start(const Reference& from) noexcept {
  Stream::start(from);
  orientation_ = from.cartesian.orientation;
  time_ = 0;
  VelocityStream<6>::Point point;
  point.x << from.cartesian.position, Vector3::Zero();
  point.v = from.cartesian.velocity;
  point.a = from.cartesian.acceleration;
  stream_->start(point);
}

bool StreamCartesianVelocity::step(const Cycle& cycle, double time, Reference& reference) noexcept {
  const auto& point = stream_->at(time, cycle.time);
  // What the twist turns, step by step.
  orientation_ = (exp((time - time_) * point.v.tail<3>()) * orientation_).normalized();
  time_ = time;
  if (SensorSample sample; input_->newest(sample)) stream_->add(Vector6::Map(sample.values.data() + kVelocityAt));
  reference.motion = Channels::kPose;
  CartesianReference& pose = reference.cartesian;
  pose.position = point.x.head<3>();
  pose.orientation = orientation_;
  pose.velocity = point.v;
  pose.acceleration = point.a;
  return false;
}

void StreamCartesianVelocity::held_back(const Reference& reference) noexcept {
  const auto& point = stream_->point();
  const auto ahead = [&](const Vector3& way, const Vector3& velocity) {
    const double most = stream_->kAhead * velocity.norm(), length = way.norm();
    return length > most ? Vector3(most / length * way) : way;
  };
  const CartesianReference& now = reference.cartesian;
  VelocityStream<6>::Vector x = point.x;
  x.head<3>() = now.position + ahead(point.x.head<3>() - now.position, point.v.head<3>());
  stream_->move_to(x);
  orientation_ = exp(ahead(log(orientation_ * now.orientation.conjugate()), point.v.tail<3>())) * now.orientation;
}

bool StreamCartesianVelocity::limited() const noexcept { return stream_->limited(); }

}  // namespace realtime
