// The arm's own time: late cycles are the simulator's fault and not the client's, and a speed is a speed.

#include "raw_client.hpp"

namespace {

using namespace testing_tools;
using fci::RobotMode;
using fci::Status;

constexpr std::int64_t kMillisecond = 1'000'000;  // ns

sim::Cell::Options at_speed(double speed) {
  sim::Cell::Options options;
  options.ideal = true;
  options.speed = speed;
  return options;
}

TEST(Pace, ItsOwnLatenessIsNotChargedToTheClient) {
  DrivenArm arm("fr3", at_speed(1));
  RawClient client(arm, 10);
  client.start({});
  const auto hold = client.hold();
  client.drive(20, [&](int) { return hold; });
  const auto late = arm.cell().pace().late();
  for (const std::int64_t stall : {3, 20, 90}) {
    arm.stall(stall * kMillisecond);
    auto before = client.state.message_id;
    auto sent = arm.now();
    for (int i = 0; i < 500; ++i) {
      client.drive(1, [&](int) { return hold; });
      ASSERT_EQ(client.state.message_id, ++before) << "after " << stall << " ms";
      if (i > 0) {
        EXPECT_GE(arm.now() - sent, 3 * kMillisecond / 4) << "no burst makes up for it";
      }
      sent = arm.now();
    }
    EXPECT_EQ(client.state.robot_mode, RobotMode::kMove);
    EXPECT_EQ(client.state.control_command_success_rate, 1);
  }
  EXPECT_EQ(arm.cell().pace().late() - late, 3u);
  EXPECT_NEAR(arm.cell().pace().worst_delay(), 0.09, 0.001);
  EXPECT_EQ(client.finish(hold), Status::kSuccess);
}

TEST(Pace, ACommandThatDoesNotComeIsNoLatenessOfTheComputers) {
  testing_tools::DrivenClock clock;
  sim::Pace pace(clock);
  for (int cycle = 0; cycle < 100; ++cycle) {
    EXPECT_FALSE(pace.wait());
    const std::int64_t patience = std::max<std::int64_t>(pace.grace() - clock.now(), 0);
    clock.stall(patience);
    pace.waited_in_vain(patience);
    clock.stall(kMillisecond / 10);  // what a cycle takes
    pace.done();
  }
  EXPECT_EQ(pace.late(), 0u);
}

TEST(Pace, WhatIsLostToALateCycleIsMadeUpFor) {
  DrivenArm arm("fr3", at_speed(1));
  RawClient client(arm, 10);
  const auto cycles = [&](int count) {
    for (int i = 0; i < count; ++i) arm.cycle();
  };
  cycles(10);
  const auto began = arm.now();
  arm.stall(20 * kMillisecond);
  cycles(200);
  EXPECT_EQ(arm.now() - began, 200 * kMillisecond);
}

TEST(Pace, ASpeedIsTheRobotsTimeOverTheClocks) {
  for (const double speed : {0.25, 0.5, 1., 4.}) {
    DrivenArm arm("fr3", at_speed(speed));
    RawClient client(arm, 10);
    client.start({});
    const auto hold = client.hold();
    client.drive(5, [&](int) { return hold; });
    const auto began = arm.now();
    const auto before = client.state.message_id;
    client.drive(100, [&](int) { return hold; });
    EXPECT_EQ(client.state.message_id - before, 100u);
    EXPECT_EQ(arm.now() - began, static_cast<std::int64_t>(100 * kMillisecond / speed));
    EXPECT_EQ(client.finish(hold), Status::kSuccess);
  }
}

}  // namespace
