#include "realtime/trajectories/stream_joint.hpp"

#include <limits>

#include "realtime/check.hpp"
#include "realtime/joint_range.hpp"
#include "realtime/trajectories/joint_rates.hpp"
#include "realtime/trajectories/target_stream.hpp"

namespace realtime {
namespace {

// Where the joints are in the numbers of each message that it takes.
const std::vector<std::string> kJointMessages = {"JointPositionSensorMessage", "JointPositionVelocitySensorMessage", "JointChunk"};
constexpr int kJointsAt[] = {2, 3, 0};

std::string check(const models::Limits& limits, const SensorSample& sample) {
  for (int i = 0; i < models::kJoints; ++i) {
    const double q = sample.values[kJointsAt[sample.message] + i];
    if (q >= rest_min(limits, i) && q <= rest_max(limits, i)) continue;
    std::string text = "joint ";
    text += std::to_string(i + 1) + " is " + std::to_string(q) + " rad: expected ";
    return text += std::to_string(rest_min(limits, i)) + " to " + std::to_string(rest_max(limits, i)) + " rad";
  }
  return "";
}

}  // namespace

StreamJoint::StreamJoint(const Parameters& parameters, const models::Limits& limits)
    : Stream(std::make_shared<SensorInput>(require_topic(parameters.topic), kJointMessages,
                                           parameters.timeout.value_or(TargetStream<models::kJoints>::kTimeout),
                                           [limits](const SensorSample& sample) { return check(limits, sample); })),
      stream_(std::make_unique<TargetStream<models::kJoints>>(parameters.delay, parameters.timeout, joint_rates(limits, parameters.speed))) {}

StreamJoint::~StreamJoint() = default;

void StreamJoint::start(const Reference& from) noexcept {
  Stream::start(from);
  stream_->start({from.joint.q, from.joint.dq, from.joint.ddq});
}

bool StreamJoint::step(const Cycle& cycle, double time, Reference& reference) noexcept {
  for (SensorSample sample; input_->take(sample);) {
    const double sent = sample.sent_ns != 0 ? 1e-9 * static_cast<double>(sample.sent_ns)
                                            : std::numeric_limits<double>::quiet_NaN();
    const Vector7 q = Vector7::Map(sample.values.data() + kJointsAt[sample.message]);
    stream_->add(time - sample.waited, {q, sent, sample.lead, sample.replaces});
  }
  const auto point = stream_->at(time, cycle.time);
  reference.motion = Channels::kJoint;
  reference.joint = {point.x, point.v, point.a};
  return false;
}

bool StreamJoint::limited() const noexcept { return stream_->limited(); }

}  // namespace realtime
