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

std::vector<const google::protobuf::FieldDescriptor*> fields_of(const proto::Limits& limits) {
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  limits.GetReflection()->ListFields(limits, &fields);
  return fields;
}

proto::Limits at_most(proto::Limits limits, const proto::Limits& most) {
  const auto& reflection = *limits.GetReflection();
  for (const auto* field : fields_of(limits)) {
    reflection.SetDouble(&limits, field, std::min(reflection.GetDouble(limits, field), reflection.GetDouble(most, field)));
  }
  return limits;
}

// Throws Refused where one is more than `most`, which is what `whose` says.
void check(const proto::Limits& limits, const proto::Limits& most, const char* whose) {
  const auto& reflection = *limits.GetReflection();
  for (const auto* field : fields_of(limits)) {
    const double given = reflection.GetDouble(limits, field), allowed = reflection.GetDouble(most, field);
    const auto& rule = field->options().GetExtension(proto::rule);
    if (given <= allowed) continue;
    refuse(fmt::format("Limits.{} is {:g} {}: expected {:g} to {:g}, {}", field->name(), given, rule.unit(), rule.min(), allowed,
                       whose));
  }
}

}  // namespace

LimitStore::LimitStore(const LimitsConfig& lab, int fd) : lab_(lab), fd_(fd) {
  if (!load(fd_, given_)) spdlog::error("the limits that a client has set could not be read again and are gone: set them anew");
}

void LimitStore::connect(const models::Limits& arm) {
  arm_ = arm;
  allowed_.set_velocity(lab_.velocity);
  allowed_.set_acceleration(lab_.acceleration);
  allowed_.set_jerk(lab_.jerk);
  allowed_.set_torque(1);
  allowed_.set_tool_speed(arm.translation.velocity);
  allowed_.set_power(greatest_power(arm));
  // What arm it is was not known when the file was read.
  const auto look = [](const char* what, const std::optional<double>& lab, double arms, const char* unit) {
    if (lab && *lab > arms) spdlog::warn("[arm.limits] {} = {:g}: this arm allows {:g} {}, which holds", what, *lab, arms, unit);
  };
  look("tool_speed", lab_.tool_speed, allowed_.tool_speed(), "m/s");
  look("power", lab_.power, allowed_.power(), "W");
  set_most();
}

// Of the configuration, or in its place of role lab.
void LimitStore::set_most() {
  most_ = allowed_;
  most_.set_torque(lab_.torque);
  if (lab_.tool_speed) most_.set_tool_speed(*lab_.tool_speed);
  if (lab_.power) most_.set_power(*lab_.power);
  most_.MergeFrom(given_.most());
  most_ = at_most(most_, allowed_);  // the arm may be another one than that for which they were given
}

void LimitStore::change(const proto::ChangeLimits& change) {
  check(change.most(), allowed_, "the most that the robot allows, or of velocity, acceleration and jerk the configuration");
  proto::ChangeLimits given = given_;
  if (change.reset()) given.clear_limits();
  given.mutable_most()->MergeFrom(change.most());
  given.mutable_limits()->MergeFrom(change.limits());
  const auto before = std::exchange(given_, given);
  set_most();
  try {
    check(change.limits(), most_, "the most that the robot and the server's configuration ([arm.limits]) or its lab allow");
    given_.clear_reset();
    save(fd_, given_);
  } catch (...) {
    given_ = before;
    set_most();
    throw;
  }
}

proto::LimitsInForce LimitStore::list() const {
  proto::LimitsInForce out;
  *out.mutable_most() = most_;
  proto::Limits now = most_;
  now.MergeFrom(given_.limits());
  *out.mutable_now() = at_most(now, most_);
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
