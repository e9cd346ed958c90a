// Version 10's asynchronous joint motion: targets at any rate, and the robot makes the motion.

#include <gtest/gtest.h>

#include "sim/robot/dt.hpp"
#include "tests/sim/robot_rig.hpp"

namespace sim {
namespace {

using fci::Error;
using fci::RobotMode;
using fci::Status;

constexpr fci::Vector7 kVelocities = {0.655, 0.655, 0.655, 0.655, 1.315, 1.315, 1.315};
// As libfranka has it: without a target.
constexpr fci::RobotCommand kFinish = {.motion_generation_finished = true};

struct Asynchronous : testing::Test {
  RobotRig rig{as_delivered("fr3")};
  const models::Limits& limits = models::limits(rig.arm, 10);

  Asynchronous() {
    const fci::Move move{.use_async_motion_generator = true, .maximum_velocity = kVelocities};
    EXPECT_EQ(rig.robot.start(move), Status::kMotionStarted);
    cycle();
  }

  static fci::RobotCommand target(const Joints& q) { return {.q_c = array(q)}; }
  // Every cycle, with a command or without: the desired motion by differences against the limits.
  void cycle(const fci::RobotCommand* command = nullptr) {
    const fci::RobotState before = rig.state();
    command ? rig.cycle(*command) : rig.cycle();
    const fci::RobotState& now = rig.state();
    for (int i = 0; i < 7 && now.robot_mode == RobotMode::kMove; ++i) {
      const double dq = (now.q_d[i] - before.q_d[i]) / kDt, ddq = (dq - before.dq_d[i]) / kDt;
      ASSERT_NEAR(dq, now.dq_d[i], 1e-9);
      ASSERT_LE(std::abs(dq), kVelocities[i] + 1e-9) << "joint " << i + 1;
      ASSERT_LE(std::abs(ddq), limits.ddq_max[i] + 1e-6) << "joint " << i + 1;
      ASSERT_LE(std::abs(ddq - before.ddq_d[i]) / kDt, limits.dddq_max[i] + 1e-2) << "joint " << i + 1;
    }
  }
  void cycle(const fci::RobotCommand& command) { cycle(&command); }
  void wait(int cycles) {
    for (int i = 0; i < cycles; ++i) cycle();
  }
  bool rests_at(const Joints& q) const {
    return (reported(rig.state().q_d) - q).norm() < 1e-9 && reported(rig.state().dq_d).norm() < 1e-9;
  }
};

TEST_F(Asynchronous, GoesToItsTargetByItself) {
  const Joints start = rig.q(), goal = start + Joints::Constant(0.25);
  wait(500);  // no target yet
  EXPECT_LT((rig.q() - start).norm(), 1e-3);
  cycle(target(goal));
  wait(300);
  EXPECT_NEAR(rig.state().dq_d[0], kVelocities[0], 1e-6);
  wait(700);  // nothing comes, and nothing is lost
  EXPECT_TRUE(rests_at(goal));
  EXPECT_LT((rig.q() - goal).norm(), 5e-3);
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kMove);
  EXPECT_EQ(rig.state().control_command_success_rate, 1);
  cycle(kFinish);
  EXPECT_EQ(rig.robot.outcome(), Status::kSuccess);
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
}

TEST_F(Asynchronous, FollowsTheNewestOfTargetsAtAnyRate) {
  const Joints start = rig.q();
  Joints goal = start;
  for (const int period : {20, 1, 7, 100, 3}) {
    for (int i = 0; i < 6; ++i) {
      goal = start + (i % 2 == 0 ? 0.2 : -0.1) * Joints::Ones();
      cycle(target(goal));
      wait(period - 1);
    }
  }
  wait(1500);
  EXPECT_TRUE(rests_at(goal));
}

TEST_F(Asynchronous, ACommandMayAnswerAnyStateSinceTheOneBefore) {
  const Joints start = rig.q();
  const auto answers = [&](std::uint64_t id, double way) {
    fci::RobotCommand command = target(start + Joints::Constant(way));
    command.message_id = id;
    return rig.robot.takes(command);
  };
  wait(100);
  const std::uint64_t now = rig.state().message_id;
  EXPECT_FALSE(answers(now - 101, 0.1)) << "before the motion";
  EXPECT_FALSE(answers(now + 1, 0.1)) << "no state yet";
  EXPECT_TRUE(answers(now - 50, 0.1));
  EXPECT_TRUE(answers(now - 50, 0.1)) << "another answer to the same";
  EXPECT_TRUE(answers(now - 20, 0.1));
  EXPECT_FALSE(answers(now - 50, 0.1)) << "overtaken";
}

TEST_F(Asynchronous, FinishedOnItsWayItEndsAtItsTarget) {
  const Joints goal = rig.q() - Joints::Constant(0.2);
  cycle(target(goal));
  wait(100);
  cycle(kFinish);
  EXPECT_EQ(rig.robot.outcome(), std::nullopt);
  for (int i = 0; i < 1000 && !rig.robot.outcome(); ++i) cycle();
  EXPECT_EQ(rig.robot.outcome(), Status::kSuccess);
  EXPECT_TRUE(rests_at(goal));
  EXPECT_FALSE(fci::any(rig.state().errors));
}

TEST_F(Asynchronous, IsStopped) {
  cycle(target(rig.q() + Joints::Constant(0.2)));
  wait(100);
  rig.robot.stop();
  for (int i = 0; i < 1000 && !rig.robot.outcome(); ++i) rig.cycle();
  EXPECT_EQ(rig.robot.outcome(), Status::kPreempted);
  EXPECT_FALSE(fci::any(rig.state().errors));
}

TEST_F(Asynchronous, RefusesTargetsOutsideTheRange) {
  Joints goal = rig.q();
  goal[3] = limits.q_max[3] + 0.001;
  cycle(target(goal));
  EXPECT_EQ(rig.robot.outcome(), Status::kReflexAborted);
  EXPECT_TRUE(rig.state().errors[static_cast<std::size_t>(Error::kJointPositionLimits)]);
}

TEST_F(Asynchronous, GoesAsNearToTheEndOfARangeAsTheEnvelopeLetsIt) {
  Joints goal = rig.q();
  goal[0] = limits.q_max[0];
  while (limits.dq_upper(0, goal[0]) < 0.2) goal[0] -= 1e-3;
  cycle(target(goal));
  for (int i = 0; i < 60'000 && !rests_at(goal); ++i) cycle();
  EXPECT_TRUE(rests_at(goal));
  EXPECT_FALSE(fci::any(rig.state().errors)) << fci::names(rig.state().errors);
}

TEST_F(Asynchronous, RefusesTargetsThatAreNone) {
  Joints goal = rig.q();
  goal[3] = std::numeric_limits<double>::quiet_NaN();
  cycle(target(goal));
  EXPECT_EQ(rig.robot.outcome(), Status::kInputErrorAborted);
}

}  // namespace
}  // namespace sim
