// Commands that are lost, late, or somebody else's.

#include <cmath>

#include "raw_client.hpp"
#include "sim/robot/dt.hpp"

namespace {

using namespace testing_tools;
using fci::Error;
using fci::RobotMode;
using fci::Status;
using Mode = fci::MotionGeneratorMode;

using sim::kDt;

struct Communication : testing::Test {
  DrivenArm arm{"fr3", lockstep(true)};
  RawClient client{arm, 9};  // states of float64
};

constexpr double kRise = 0.5;  // m/s² or rad/s²

// Velocity that rises with constant acceleration, after its onset.
double rising(int cycle) { return kRise * kDt * std::max(cycle - 3, 0); }

TEST_F(Communication, ALostPoseIsExtrapolatedWithConstantAcceleration) {
  client.start({.motion_generator_mode = Mode::kCartesianVelocity});
  client.drive(50, [](int cycle) {
    fci::RobotCommand command;
    command.O_dP_EE_c = {0, 0.5 * rising(cycle), rising(cycle), 0, 0, -rising(cycle)};
    return command;
  });
  auto before = client.state;
  for (int lost = 0; lost < 3; ++lost) {
    client.receive();
    const auto& now = client.state;
    ASSERT_EQ(now.message_id, before.message_id + 1);
    for (int i = 0; i < 6; ++i) {
      EXPECT_NEAR(now.O_ddP_EE_c[i], before.O_ddP_EE_c[i], 1e-5) << i;
      EXPECT_NEAR(now.O_dP_EE_c[i], before.O_dP_EE_c[i] + kDt * before.O_ddP_EE_c[i], 1e-8);
    }
    for (int i = 0; i < 3; ++i) {
      EXPECT_NEAR(now.O_T_EE_c[12 + i], before.O_T_EE_c[12 + i] + kDt * now.O_dP_EE_c[i], 1e-12);
    }
    before = now;
  }
  // Whoever goes on where the arm went is not punished for the loss.
  client.drive(100, [&](int cycle) {
    fci::RobotCommand command;
    const double v = std::max(rising(49) + kRise * kDt * (3 - std::max(cycle - 1, 0)), 0.);
    command.O_dP_EE_c = {0, 0.5 * v, v, 0, 0, -v};
    return command;
  });
  EXPECT_EQ(client.finish({}), Status::kSuccess);
}

TEST_F(Communication, WhoGoesOnAsIfNothingWereLostWhileTheArmExtrapolatesIsADiscontinuity) {
  client.start({});
  const auto begin = client.state;
  fci::RobotCommand command;
  command.q_c = begin.q_d;
  // At 0.5 rad/s the client stops commanding motion in the cycle that is lost.
  const auto q7 = [&](int cycle) {
    const double t = std::min(cycle, 100) * kDt;
    return begin.q_d[6] + 2.5 * t * t;  // 5 rad/s²
  };
  for (int cycle = 0; cycle < 100; ++cycle) {
    command.q_c[6] = q7(cycle);
    client.send(command);
    client.receive();
  }
  client.receive();  // lost; the arm has moved on by half a milliradian
  EXPECT_NEAR(client.state.dq_d[6], 0.5, 0.01);
  command.q_c[6] = q7(100);
  client.send(command);
  client.receive();
  EXPECT_EQ(client.state.robot_mode, RobotMode::kReflex);
  EXPECT_TRUE(client.state.errors[static_cast<std::size_t>(Error::kJointVelocityDiscontinuity)]);
}

TEST_F(Communication, ALostTorqueIsTheLastOne) {
  client.start(kTorque);
  fci::RobotCommand command;
  command.tau_J_d = {0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7};
  client.drive(3, [&](int) { return command; });
  for (int lost = 0; lost < 2; ++lost) {
    client.receive();
    EXPECT_EQ(client.state.tau_J_d, command.tau_J_d);
  }
  EXPECT_EQ(client.finish({}), Status::kSuccess);
}

TEST_F(Communication, TheSuccessRateIsThatOfTheLastHundred) {
  EXPECT_EQ(client.state.control_command_success_rate, 0);
  client.start({});
  const auto hold = client.hold();
  client.drive(3, [&](int) { return hold; });
  EXPECT_EQ(client.state.control_command_success_rate, 1);
  client.receive();
  EXPECT_DOUBLE_EQ(client.state.control_command_success_rate, 0.75);
  client.drive(40, [&](int) { return hold; });
  client.receive();
  EXPECT_DOUBLE_EQ(client.state.control_command_success_rate, 43. / 45);
  client.drive(58, [&](int) { return hold; });
  EXPECT_DOUBLE_EQ(client.state.control_command_success_rate, 0.98);
  client.drive(1, [&](int) { return hold; });
  EXPECT_DOUBLE_EQ(client.state.control_command_success_rate, 0.99);
  client.drive(41, [&](int) { return hold; });
  EXPECT_DOUBLE_EQ(client.state.control_command_success_rate, 1);
  EXPECT_EQ(client.finish(hold), Status::kSuccess);
  EXPECT_EQ(client.state.control_command_success_rate, 0);
}

TEST_F(Communication, NineteenLostCommandsDoNotEndAMotion) {
  client.start({});
  const auto hold = client.hold();
  client.drive(3, [&](int) { return hold; });
  const auto last = client.state.message_id;
  client.receive_until([&](const auto& state) { return state.message_id == last + 19; });
  client.drive(3, [&](int) { return hold; });
  EXPECT_EQ(client.state.robot_mode, RobotMode::kMove);
  EXPECT_EQ(client.finish(hold), Status::kSuccess);
}

TEST_F(Communication, CommandsOfOthersAndForOtherCyclesAreNone) {
  client.start(kTorque);
  fci::RobotCommand mine, wrong;
  mine.tau_J_d[6] = 0.25;
  wrong.tau_J_d[6] = 0.75;
  client.drive(3, [&](int) { return mine; });

  // From another socket, to where the arm listens, for the right cycle.
  const int stranger = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(fci::kRobotPort);
  ::inet_pton(AF_INET, arm.address().c_str(), &to.sin_addr);
  wrong.message_id = client.state.message_id;
  std::array<std::byte, fci::kMaxCommandSize> bytes;
  const std::size_t size = fci::write(fci::Version{9}, wrong, bytes);
  ::sendto(stranger, bytes.data(), size, 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
  ::close(stranger);
  client.drive(1, [&](int) { return mine; });
  EXPECT_EQ(client.state.tau_J_d[6], 0.25);

  // For a cycle that has not been, and for one that is over.
  for (const int shift : {+5, -2}) {
    const auto now = client.state;
    client.state.message_id += static_cast<std::uint64_t>(shift);
    client.send(wrong);
    client.state = now;
    client.drive(1, [&](int) { return mine; });
    EXPECT_EQ(client.state.message_id, now.message_id + 1);
    EXPECT_EQ(client.state.tau_J_d[6], 0.25);
  }
  EXPECT_EQ(client.state.control_command_success_rate, 1);
  EXPECT_EQ(client.finish({}), Status::kSuccess);
}

}  // namespace
