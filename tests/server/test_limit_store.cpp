#include "server/limit_store.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>

#include "server/arm_model.hpp"
#include "server/refused.hpp"
#include "server/shared_memory.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;

const models::Limits& kFer = models::limits(models::arm("fer"), 5);

LimitStore store_of(const LimitsConfig& lab, int fd = -1) {
  LimitStore store(lab, fd);
  store.connect(scaled(kFer, lab.velocity, lab.acceleration, lab.jerk));
  return store;
}

proto::ChangeLimits velocity(double value) {
  proto::ChangeLimits change;
  change.mutable_limits()->set_velocity(value);
  return change;
}

std::string refusal(LimitStore& store, const proto::ChangeLimits& change) {
  try {
    store.change(change);
  } catch (const Refused& refused) {
    return refused.what();
  }
  return "";
}

TEST(LimitStore, nothing_is_reduced_before_it_is_asked_for) {
  const realtime::Bounds bounds = store_of({}).make();
  EXPECT_EQ(bounds.limits.dq_max, kFer.dq_max);
  EXPECT_EQ(bounds.limits.tau_max, kFer.tau_max);
  EXPECT_TRUE(std::isinf(bounds.tool_speed) && std::isinf(bounds.power));
}

TEST(LimitStore, shares_are_of_the_robots_whatever_the_lab_allows) {
  LimitStore store = store_of({.velocity = 0.5, .torque = 0.8});
  EXPECT_DOUBLE_EQ(store.make().limits.dq_max[0], 0.5 * kFer.dq_max[0]);
  EXPECT_DOUBLE_EQ(store.make().limits.tau_max[0], 0.8 * kFer.tau_max[0]);
  store.change(velocity(0.2));
  EXPECT_DOUBLE_EQ(store.make().limits.dq_max[0], 0.2 * kFer.dq_max[0]);
  EXPECT_DOUBLE_EQ(store.make().limits.translation.velocity, 0.2 * kFer.translation.velocity);
  EXPECT_EQ(store.make().limits.ddq_max, kFer.ddq_max);
  EXPECT_EQ(store.make().limits.q_max, kFer.q_max);
}

TEST(LimitStore, nothing_goes_beyond_the_lab_or_the_robot) {
  LimitStore store = store_of({.velocity = 0.5, .power = 80});
  EXPECT_EQ(refusal(store, velocity(0.6)), "Limits.velocity is 0.6 of the robot's: expected 0.01 to 0.5, the most that the robot and "
                                           "the server's configuration ([arm.limits]) or its lab allow");
  proto::ChangeLimits change;
  change.mutable_limits()->set_jerk(0.5);
  change.mutable_limits()->set_power(100);
  EXPECT_NE(refusal(store, change).find("power is 100 W: expected 1 to 80"), std::string::npos);
  EXPECT_EQ(store.list().now().jerk(), 1) << "all or none";
  change.mutable_limits()->set_power(80);
  change.mutable_limits()->set_tool_speed(kFer.translation.velocity);
  EXPECT_NE(refusal(store, change).find("tool_speed is 1.7 m/s: expected 0.01 to 0.85"), std::string::npos);
  EXPECT_EQ(store.make().power, 80);
}

TEST(LimitStore, the_lab_allows_less_or_more_than_its_file_and_no_more_than_the_robot) {
  const int fd = make_memory_file("limits", 0);
  LimitStore store = store_of({.velocity = 0.5, .torque = 0.5, .tool_speed = 0.25}, fd);
  const auto allow = [&](const char* field, double value) {
    proto::ChangeLimits change;
    change.mutable_most()->GetReflection()->SetDouble(change.mutable_most(), proto::Limits::descriptor()->FindFieldByName(field), value);
    return refusal(store, change);
  };
  EXPECT_EQ(allow("torque", 1), "");
  EXPECT_EQ(store.make().limits.tau_max, kFer.tau_max);
  EXPECT_EQ(allow("tool_speed", 0.8), "");
  EXPECT_EQ(store.list().now().tool_speed(), 0.8);
  EXPECT_NE(allow("tool_speed", 0.9).find("expected 0.01 to 0.85, the most that the robot allows"), std::string::npos);
  EXPECT_NE(allow("velocity", 0.6).find("velocity is 0.6 of the robot's: expected 0.01 to 0.5"), std::string::npos);
  EXPECT_EQ(allow("velocity", 0.1), "");
  EXPECT_DOUBLE_EQ(store.make().limits.dq_max[0], 0.1 * kFer.dq_max[0]);
  EXPECT_NE(refusal(store, velocity(0.2)).find("expected 0.01 to 0.1"), std::string::npos);
  proto::ChangeLimits reset;
  reset.set_reset(true);
  store.change(reset);
  EXPECT_EQ(store.list().now().velocity(), 0.1);
  EXPECT_EQ(store_of({.velocity = 0.5, .torque = 0.5}, fd).list().most().velocity(), 0.1) << "outlives the process";
  close(fd);
}

TEST(LimitStore, a_tool_speed_bounds_poses_too) {
  LimitStore store = store_of({.tool_speed = 0.25});
  EXPECT_EQ(store.make().tool_speed, 0.25);
  EXPECT_EQ(store.make().limits.translation.velocity, 0.25);
  EXPECT_EQ(store.list().most().tool_speed(), 0.25);
}

TEST(LimitStore, what_is_given_outlives_the_process_and_goes_with_a_reset) {
  const int fd = make_memory_file("limits", 0);
  store_of({}, fd).change(velocity(0.3));
  LimitStore store = store_of({}, fd);
  EXPECT_EQ(store.list().now().velocity(), 0.3);
  proto::ChangeLimits change;
  change.set_reset(true);
  change.mutable_limits()->set_torque(0.5);
  store.change(change);
  EXPECT_EQ(store.list().now().velocity(), 1);
  EXPECT_EQ(store_of({}, fd).list().now().torque(), 0.5);
  close(fd);
}

}  // namespace
}  // namespace server
