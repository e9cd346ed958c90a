#include "server/limit_store.hpp"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "frankapy/proto/rules.pb.h"
#include "server/arm_model.hpp"
#include "server/kept.hpp"
#include "server/refused.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;

// All that its joints can do at once, W.
double greatest_power(const models::Limits& arm) {
  double power = 0;
  for (int i = 0; i < models::kJoints; ++i) power += arm.tau_max[i] * arm.dq_max[i];
  return power;
}

}  // namespace

LimitStore::LimitStore(const LimitsConfig& lab, int fd) : lab_(lab), fd_(fd) {
  if (!load(fd_, reduced_)) spdlog::error("the limits that a client has set could not be read again and are gone: set them anew");
}

void LimitStore::connect(const models::Limits& arm) {
  arm_ = arm;
  most_.set_velocity(lab_.velocity);
  most_.set_acceleration(lab_.acceleration);
  most_.set_jerk(lab_.jerk);
  most_.set_torque(lab_.torque);
  most_.set_tool_speed(std::min(lab_.tool_speed.value_or(arm.translation.velocity), arm.translation.velocity));
  most_.set_power(std::min(lab_.power.value_or(greatest_power(arm)), greatest_power(arm)));
}

void LimitStore::change(const proto::ChangeLimits& change) {
  proto::Limits reduced = change.reset() ? proto::Limits() : reduced_;
  reduced.MergeFrom(change.limits());
  const auto& reflection = *reduced.GetReflection();
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  reflection.ListFields(reduced, &fields);
  for (const auto* field : fields) {
    const double given = reflection.GetDouble(reduced, field), most = reflection.GetDouble(most_, field);
    const auto& rule = field->options().GetExtension(proto::rule);
    if (given <= most) continue;
    throw Refused(proto::Error::INVALID_ARGUMENT,
                  fmt::format("Limits.{} is {:g} {}: expected {:g} to {:g}, the most that the robot and the server's "
                              "configuration ([arm.limits]) allow",
                              field->name(), given, rule.unit(), rule.min(), most));
  }
  reduced_ = std::move(reduced);
  save(fd_, reduced_);
}

proto::LimitsInForce LimitStore::list() const {
  proto::LimitsInForce out;
  *out.mutable_most() = most_;
  *out.mutable_now() = most_;
  // The arm may be another one than that for which they were given.
  const auto& reflection = *reduced_.GetReflection();
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  reflection.ListFields(reduced_, &fields);
  for (const auto* field : fields) {
    const double given = reflection.GetDouble(reduced_, field), most = reflection.GetDouble(most_, field);
    reflection.SetDouble(out.mutable_now(), field, std::min(given, most));
  }
  return out;
}

realtime::Bounds LimitStore::make() const {
  const proto::Limits now = list().now();
  realtime::Bounds bounds(
      scaled(arm_, now.velocity() / lab_.velocity, now.acceleration() / lab_.acceleration, now.jerk() / lab_.jerk));
  for (double& tau_max : bounds.limits.tau_max) tau_max *= now.torque();
  if (now.tool_speed() < arm_.translation.velocity) {
    bounds.tool_speed = now.tool_speed();
    bounds.limits.translation.velocity = std::min(bounds.limits.translation.velocity, now.tool_speed());
  }
  if (now.power() < greatest_power(arm_)) bounds.power = now.power();
  return bounds;
}

}  // namespace server
