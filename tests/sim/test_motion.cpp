// The nine robot controllers over the wire: order of states and answers, losses, reflexes, determinism.

#include <cmath>
#include <filesystem>

#include "models/arm.hpp"
#include "raw_client.hpp"
#include "truth.hpp"

namespace {

using namespace testing_tools;
using fci::ControllerMode;
using fci::Error;
using fci::RobotMode;
using fci::Status;
using Mode = fci::MotionGeneratorMode;

constexpr int kCycles = 500;       // of a motion
constexpr double kAngle = 0.1;     // rad, of the last joint
constexpr double kDistance = 0.04;  // m, upwards

// Minimum jerk from 0 to 1 in kCycles: value, and rate in 1/s.
std::pair<double, double> profile(double cycle) {
  const double s = std::clamp(cycle / kCycles, 0., 1.);
  return {s * s * s * (10 - 15 * s + 6 * s * s), 30 * s * s * (1 - s) * (1 - s) * 1000 / kCycles};
}

// What moves the last joint, or the tool, along the profile from the state of the start.
fci::RobotCommand reference(const fci::RobotState& start, int cycle) {
  const auto [value, rate] = profile(cycle);
  fci::RobotCommand command;
  command.q_c = start.q_d;
  command.q_c[6] += kAngle * value;
  command.dq_c[6] = kAngle * rate;
  command.O_T_EE_c = start.O_T_EE_c;
  command.O_T_EE_c[14] += kDistance * value;
  command.O_dP_EE_c[2] = kDistance * rate;
  return command;
}

struct Control {
  int version;
  ControllerMode controller;
  Mode generator;
};
std::string title(const testing::TestParamInfo<Control>& info) {
  const std::array controllers = {"JointImpedance", "CartesianImpedance", "Torque"};
  const std::array generators = {"", "JointPosition", "JointVelocity", "CartesianPosition", "CartesianVelocity", "Alone"};
  return std::string(controllers[static_cast<int>(info.param.controller)]) +
         generators[static_cast<int>(info.param.generator)] + "Version" + std::to_string(info.param.version);
}
std::vector<Control> all_controls() {
  std::vector<Control> all;
  for (int version : {5, 7, 10}) {
    for (const auto controller :
         {ControllerMode::kJointImpedance, ControllerMode::kCartesianImpedance, ControllerMode::kExternal}) {
      for (int generator = 1; generator <= 5; ++generator) {
        if (generator == 5 && (version < 7 || controller != ControllerMode::kExternal)) continue;
        all.push_back({version, controller, static_cast<Mode>(generator)});
      }
    }
  }
  return all;
}

class EveryControl : public testing::TestWithParam<Control> {};
INSTANTIATE_TEST_SUITE_P(Robot, EveryControl, testing::ValuesIn(all_controls()), title);

TEST_P(EveryControl, MovesTheArmAsCommanded) {
  const auto [version, controller, generator] = GetParam();
  DrivenArm arm(version == 5 ? "fer" : "fr3", lockstep());
  RawClient client(arm, static_cast<fci::Version>(version));
  client.start({.controller_mode = controller, .motion_generator_mode = generator});
  const fci::RobotState start = client.state;
  const bool torques = controller == ControllerMode::kExternal;
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(start.dq_d[i], 0);
    EXPECT_EQ(start.ddq_d[i], 0);
    if (torques) {
      EXPECT_EQ(start.tau_J_d[i], 0);
    }
  }
  const fci::Vector7 stiffness = {600, 600, 600, 600, 250, 150, 50};
  const bool alone = generator == Mode::kNone;
  const auto make = [&](int cycle) {
    fci::RobotCommand command = reference(start, cycle);
    for (int i = 0; torques && i < 7; ++i) {
      const double q_d = alone ? command.q_c[i] : client.state.q_d[i];
      const double dq_d = alone ? command.dq_c[i] : client.state.dq_d[i];
      command.tau_J_d[i] = stiffness[i] * (q_d - client.state.q[i]) +
                           1.2 * std::sqrt(stiffness[i]) * (dq_d - client.state.dq[i]);
    }
    return command;
  };
  client.drive(kCycles + 300, make);
  EXPECT_EQ(client.state.message_id, start.message_id + kCycles + 300);
  EXPECT_EQ(client.state.control_command_success_rate, 1);
  const fci::RobotState end = client.state;
  EXPECT_EQ(client.finish(make(kCycles)), Status::kSuccess);

  const double tolerance = torques ? 0.02 : 0.006;
  if (generator == Mode::kCartesianPosition || generator == Mode::kCartesianVelocity) {
    EXPECT_NEAR(end.O_T_EE[14] - start.O_T_EE[14], kDistance, tolerance / 2);
    EXPECT_NEAR(end.O_T_EE_c[14] - start.O_T_EE_c[14], kDistance, 1e-4);
  } else {
    EXPECT_NEAR(end.q[6] - start.q[6], kAngle, tolerance);
    if (!alone) {
      EXPECT_NEAR(end.q_d[6] - start.q_d[6], kAngle, 1e-4);
    }
  }
}

TEST(Motion, ModesChangeTogetherAndAnswersFollowTheStatesThatShowThem) {
  DrivenArm arm("fr3", lockstep());
  RawClient client(arm, 10);
  const auto id = client.post(kTorque);
  EXPECT_EQ(client.answer(id), Status::kMotionStarted);
  client.receive_until([&](const fci::RobotState& state) {
    const bool idle = RawClient::idle(state);
    EXPECT_TRUE(idle || client.shows(kTorque));
    return !idle;
  });
  // Cycles without a command before the first are no losses, however many.
  for (int i = 0; i < 50; ++i) client.receive();
  EXPECT_TRUE(client.shows(kTorque));
  EXPECT_EQ(client.state.control_command_success_rate, 0);
  client.newest();
  client.drive(30, [&](int) { return fci::RobotCommand{}; });
  EXPECT_FALSE(client.sockets.readable());

  fci::RobotCommand last;
  last.torque_command_finished = true;
  client.send(last);
  client.receive();
  EXPECT_TRUE(RawClient::idle(client.state));
  EXPECT_EQ(client.answer(id), Status::kSuccess);
}

TEST(Motion, InLockstepNoTimePassesWhereTheCommandIsThereAlready) {
  DrivenArm arm("fr3", lockstep());
  RawClient client(arm, 10);
  client.start(kTorque);
  client.drive(1, [](int) { return fci::RobotCommand{}; });
  const std::int64_t before = arm.now();
  client.drive(100, [](int) { return fci::RobotCommand{}; });
  EXPECT_EQ(arm.now(), before);
}

TEST(Motion, TheNextStartsTwoStatesAfterTheFinishFlag) {
  DrivenArm arm("fr3", lockstep());
  RawClient client(arm, 10);
  client.start({});
  std::uint64_t least = 1000;
  bool torques = false;
  for (int i = 0; i < 20; ++i) {
    auto command = client.hold();
    client.drive(5, [&](int) { return command; });
    command.motion_generation_finished = command.torque_command_finished = true;
    client.send(command);
    const auto finished = client.state.message_id;
    client.receive();
    ASSERT_TRUE(RawClient::idle(client.state));
    EXPECT_EQ(client.state.message_id, finished + 1);
    const fci::Vector7 q_d = client.state.q_d;

    // The Move goes out on the first idle state, the finish flag once more with it, as libfranka would.
    torques = !torques;
    const fci::Move move{.controller_mode = torques ? ControllerMode::kExternal : ControllerMode::kJointImpedance,
                         .motion_generator_mode = torques ? Mode::kNone : Mode::kJointPosition};
    const auto id = client.post(move);
    client.send(command);
    EXPECT_EQ(client.answer(client.move_id), Status::kSuccess);
    EXPECT_EQ(client.answer(id), Status::kMotionStarted);
    client.move_id = id;
    client.receive_until([&](const auto&) { return client.shows(move); });
    least = std::min(least, client.state.message_id - finished);
    for (int j = 0; j < 7; ++j) EXPECT_NEAR(client.state.q_d[j], q_d[j], 1e-6);
    while (client.sockets.datagram_there()) client.receive();
    EXPECT_TRUE(client.shows(move)) << "the flag of the motion before has ended this one";
  }
  EXPECT_EQ(least, 2u);  // under load a Move may come a cycle later, never sooner
}

TEST(Motion, LostCommandsAreExtrapolatedAndCounted) {
  DrivenArm arm("fer", lockstep(true));
  RawClient client(arm, 5);
  client.start({.motion_generator_mode = Mode::kJointVelocity});
  const auto start = client.state;
  const int half = kCycles / 2;
  client.drive(half, [&](int cycle) { return reference(start, cycle); });
  const auto before = client.state;
  client.receive();  // after this one's command has stayed out
  const auto after = client.state;
  EXPECT_EQ(after.message_id, before.message_id + 1);
  EXPECT_NEAR(after.ddq_d[6], before.ddq_d[6], 1e-9);
  EXPECT_NEAR(after.dq_d[6], before.dq_d[6] + 0.001 * before.ddq_d[6], 1e-9);
  EXPECT_NEAR(after.control_command_success_rate, 0.99, 1e-9);
  client.drive(half, [&](int cycle) { return reference(start, half + 1 + cycle); });
  EXPECT_EQ(client.state.control_command_success_rate, 1);
  EXPECT_NEAR(client.state.q_d[6] - start.q_d[6], kAngle, 1e-4);
  EXPECT_EQ(client.finish(reference(start, kCycles)), Status::kSuccess);
}

TEST(Motion, ALateCommandIsLost) {
  DrivenArm arm("fr3", lockstep());
  RawClient client(arm, 10);
  client.start(kTorque);
  fci::RobotCommand command;
  client.drive(5, [&](int) { return command; });
  command.tau_J_d[6] = 0.5;
  auto late = client.state;
  client.receive();  // the arm has given up waiting
  std::swap(late, client.state);
  client.send(command);
  std::swap(late, client.state);
  command.tau_J_d[6] = 0.25;
  client.drive(1, [&](int) { return command; });
  EXPECT_EQ(client.state.tau_J_d[6], 0.25);
  EXPECT_LT(client.state.control_command_success_rate, 1);
  EXPECT_EQ(client.finish({}), Status::kSuccess);
}

void expect_reflex(RawClient& client, Error error, Status status = Status::kReflexAborted) {
  if (client.state.robot_mode == RobotMode::kMove) client.receive();
  EXPECT_EQ(client.state.robot_mode, RobotMode::kReflex);
  EXPECT_EQ(client.state.motion_generator_mode, Mode::kIdle);
  EXPECT_NE(client.state.controller_mode, ControllerMode::kExternal);
  EXPECT_TRUE(client.state.errors[static_cast<std::size_t>(error)]) << fci::names(client.state.errors);
  EXPECT_EQ(client.state.errors, client.state.reflex_reason);
  EXPECT_EQ(client.answer(client.move_id), status);
  EXPECT_EQ(client.ask(fci::SetJointImpedance{}), Status::kNotPossible);
  EXPECT_EQ(client.ask(fci::Move{}), Status::kNotPossible);
  while (client.sockets.datagram_there()) client.receive();

  const auto id = client.post(fci::AutomaticErrorRecovery{});
  client.receive_until([](const auto& state) { return state.robot_mode == RobotMode::kAutomaticErrorRecovery; });
  client.receive_until([](const auto& state) { return RawClient::idle(state); });
  EXPECT_EQ(client.answer(id), Status::kSuccess);
  EXPECT_FALSE(fci::any(client.state.errors));
  EXPECT_TRUE(client.state.reflex_reason[static_cast<std::size_t>(error)]);

  client.start({});
  EXPECT_FALSE(fci::any(client.state.reflex_reason));
  const auto hold = client.hold();
  client.drive(5, [&](int) { return hold; });
  EXPECT_EQ(client.finish(hold), Status::kSuccess);
}

TEST(Motion, TwentyLostCommandsEndIt) {
  DrivenArm arm;
  RawClient client(arm, 10);
  client.start({});
  const auto hold = client.hold();
  client.drive(5, [&](int) { return hold; });
  const auto last = client.state.message_id;
  const auto now = arm.now();
  client.receive_until([](const auto& state) { return state.robot_mode != RobotMode::kMove; });
  EXPECT_EQ(client.state.message_id, last + 20);
  EXPECT_EQ(arm.now() - now, 20 * 1'000'000);
  expect_reflex(client, Error::kCommunicationConstraints);
}

TEST(Motion, ASilentClientInLockstepEndsItToo) {
  auto options = lockstep();
  options.patience = 30'000'000;
  DrivenArm arm("fr3", options);
  RawClient client(arm, 10);
  client.start({});
  const auto hold = client.hold();
  client.drive(3, [&](int) { return hold; });
  const auto last = client.state.message_id;
  const auto now = arm.now();
  client.receive_until([](const auto& state) { return state.robot_mode == RobotMode::kReflex; });
  EXPECT_EQ(client.state.message_id, last + 20);
  EXPECT_EQ(arm.now() - now, 20 * options.patience);
}

TEST(Motion, FinishingWhileMovingIsAReflex) {
  DrivenArm arm("fr3", lockstep());
  RawClient client(arm, 10);
  client.start({});
  const auto start = client.state;
  client.drive(kCycles / 2, [&](int cycle) { return reference(start, cycle); });
  auto command = reference(start, kCycles / 2);
  command.motion_generation_finished = true;
  client.send(command);
  expect_reflex(client, Error::kJointVelocityDiscontinuity);
}

TEST(Motion, FinishingUnderTorquesWhileTheArmMovesIsAReflex) {
  struct Case {
    int version;
    Mode generator;
  };
  for (const Case& motion : {Case{10, Mode::kNone}, {10, Mode::kJointPosition}, {10, Mode::kCartesianVelocity},
                             {5, Mode::kJointVelocity}}) {
    DrivenArm arm(motion.version == 5 ? "fer" : "fr3", lockstep(true));
    RawClient client(arm, static_cast<fci::Version>(motion.version));
    client.start({.controller_mode = ControllerMode::kExternal, .motion_generator_mode = motion.generator});
    // The reference rests, and the last joint is turned; as fast as 0.1 rad/s counts as moving.
    fci::RobotCommand command = client.hold();
    command.tau_J_d[6] = 0.5;
    for (int i = 0; i < 500 && client.state.dq[6] < 0.3; ++i) client.drive(1, [&](int) { return command; });
    ASSERT_GT(client.state.dq[6], 0.3);
    ASSERT_EQ(client.state.robot_mode, RobotMode::kMove);
    command.motion_generation_finished = command.torque_command_finished = true;
    client.send(command);
    expect_reflex(client, Error::kJointVelocityDiscontinuity);
  }
}

// A reference beside the torques moves nothing, so it need not rest.
TEST(Motion, FinishingUnderTorquesTakesAReferenceThatMoves) {
  for (const int version : {5, 7, 10}) {
    DrivenArm arm(version == 5 ? "fer" : "fr3", lockstep(true));
    RawClient client(arm, static_cast<fci::Version>(version));
    client.start({.controller_mode = ControllerMode::kExternal, .motion_generator_mode = Mode::kJointPosition});
    const auto start = client.state;
    const auto make = [&](int cycle) {
      fci::RobotCommand command = reference(start, cycle);
      command.tau_J_d = {};
      return command;
    };
    client.drive(kCycles / 2, make);
    ASSERT_EQ(client.state.robot_mode, RobotMode::kMove);
    auto command = make(kCycles / 2);
    command.torque_command_finished = true;
    EXPECT_EQ(client.finish(command), Status::kSuccess) << "version " << version;
    EXPECT_FALSE(fci::any(client.newest().errors)) << fci::names(client.state.errors);
  }
}

TEST(Motion, ACommandThatIsNoneEndsIt) {
  DrivenArm arm("fr3", lockstep());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  struct Case {
    ControllerMode controller;
    Mode generator;
    Error error;
    std::function<void(fci::RobotCommand&)> spoil;
  };
  const auto kJoint = ControllerMode::kJointImpedance;
  const std::vector<Case> cases = {
      {kJoint, Mode::kJointPosition, Error::kJointPositionLimits, [=](auto& c) { c.q_c[3] = nan; }},
      {kJoint, Mode::kJointVelocity, Error::kJointVelocityLimitsCommanded, [=](auto& c) { c.dq_c[0] = HUGE_VAL; }},
      {kJoint, Mode::kCartesianPosition, Error::kCartesianInvalidFrame, [=](auto& c) { c.O_T_EE_c[0] = 2; }},
      {kJoint, Mode::kCartesianPosition, Error::kCartesianInvalidFrame, [=](auto& c) { c.O_T_EE_c[12] = nan; }},
      {kJoint, Mode::kCartesianVelocity, Error::kCartesianVelocityLimits, [=](auto& c) { c.O_dP_EE_c[5] = nan; }},
      {ControllerMode::kExternal, Mode::kNone, Error::kControllerTorqueDiscontinuity,
       [=](auto& c) { c.tau_J_d[6] = -HUGE_VAL; }},
  };
  RawClient client(arm, 10);
  for (const Case& wrong : cases) {
    client.start({.controller_mode = wrong.controller, .motion_generator_mode = wrong.generator});
    auto command = client.hold();
    client.drive(3, [&](int) { return command; });
    wrong.spoil(command);
    client.send(command);
    expect_reflex(client, wrong.error, Status::kInputErrorAborted);
  }
}

// Down into a plate, as one who misjudged its height.
TEST(Motion, WhatItRunsIntoStopsIt) {
  auto options = lockstep();
  options.scene = REPOSITORY_DIR "/sim/scenes/plate.xml";
  DrivenArm arm("fr3", options);
  struct Case {
    double torque, force;
    Error error;
  };
  for (const Case& guard : {Case{100, 20, Error::kCartesianReflex}, {3, 200, Error::kJointReflex}}) {
    RawClient client(arm, 10);
    ASSERT_EQ(client.ask(thresholds(100, 100)), Status::kSuccess);
    client.start({.motion_generator_mode = Mode::kCartesianPosition});  // above the plate
    const auto start = client.state;
    const auto above = [&](int i) {
      fci::RobotCommand command;
      command.O_T_EE_c = start.O_T_EE_c;
      command.O_T_EE_c[12] += (0.5 - start.O_T_EE_c[12]) * profile(i / 3.).first;
      return command;
    };
    client.drive(3 * kCycles + 100, above);
    ASSERT_EQ(client.finish(above(3 * kCycles)), Status::kSuccess);

    ASSERT_EQ(client.ask(thresholds(guard.torque, guard.force)), Status::kSuccess);
    client.start({.motion_generator_mode = Mode::kCartesianVelocity});
    fci::RobotCommand command;
    for (int i = 1; client.state.robot_mode == RobotMode::kMove && i < 6000; ++i) {
      command.O_dP_EE_c[2] = -0.1 * profile(std::min(i, kCycles)).first;
      client.drive(1, [&](int) { return command; });
    }
    EXPECT_LT(client.state.O_T_EE[14], 0.22);
    EXPECT_GT(client.state.O_T_EE[14], 0.19);
    const bool joint = guard.error == Error::kJointReflex;
    const auto other = joint ? Error::kCartesianReflex : Error::kJointReflex;
    EXPECT_FALSE(client.state.errors[static_cast<std::size_t>(other)]);
    double collisions = 0;
    for (double level : client.state.joint_collision) collisions += joint ? level : 0;
    for (double level : client.state.cartesian_collision) collisions += joint ? 0 : level;
    EXPECT_GE(collisions, 1);
    for (int i = 0; i < kCycles / 2; ++i) client.receive();  // until it has come to rest on the plate
    expect_reflex(client, guard.error);
    for (double level : client.state.joint_collision) EXPECT_EQ(level, 0);
    for (double level : client.state.cartesian_collision) EXPECT_EQ(level, 0);
    // Back up, away from the plate.
    client.start({.motion_generator_mode = Mode::kCartesianVelocity});
    client.drive(4 * kCycles, [&](int i) {
      fci::RobotCommand up;
      up.O_dP_EE_c[2] = 0.15 * (profile(i).first - profile(i - 3 * kCycles).first);
      return up;
    });
    EXPECT_EQ(client.finish({}), Status::kSuccess);
    EXPECT_GT(client.state.O_T_EE[14], 0.3);
  }
}

TEST(Motion, StopMoveBrakesAndPreempts) {
  for (const int version : {5, 10}) {
    DrivenArm arm(version == 5 ? "fer" : "fr3", lockstep());
    RawClient client(arm, static_cast<fci::Version>(version));
    client.start({.motion_generator_mode = Mode::kJointVelocity});
    const auto start = client.state;
    client.drive(kCycles / 2, [&](int cycle) { return reference(start, cycle); });
    const auto stop = client.post(fci::StopMove{});
    client.receive_until([](const auto& state) { return RawClient::idle(state); });
    EXPECT_EQ(client.answer(client.move_id), Status::kPreempted);
    EXPECT_EQ(client.answer(stop), Status::kSuccess);
    EXPECT_FALSE(fci::any(client.state.errors));
    EXPECT_LT(client.state.q_d[6] - start.q_d[6], kAngle * 0.7);
    EXPECT_EQ(client.state.dq_d[6], 0);
  }
}

TEST(Motion, AStopThatASafetyFunctionComesBeforeIsNoSuccess) {
  for (const int version : {5, 10}) {
    DrivenArm arm(version == 5 ? "fer" : "fr3", lockstep());
    RawClient client(arm, static_cast<fci::Version>(version));
    client.start({.motion_generator_mode = Mode::kJointVelocity});
    const auto start = client.state;
    client.drive(kCycles / 2, [&](int cycle) { return reference(start, cycle); });
    const double speed = std::abs(client.state.dq_d[6]);
    const auto stop = client.post(fci::StopMove{});
    client.receive_until([&](const auto& state) { return std::abs(state.dq_d[6]) < speed; });
    arm.cell().robot(0).enabling_device(false);
    client.receive_until([](const auto& state) { return state.robot_mode == RobotMode::kUserStopped; });
    EXPECT_EQ(client.answer(client.move_id), version == 5 ? Status::kEmergencyAborted : Status::kPreemptedDueToActivatedSafetyFunctions);
    EXPECT_EQ(client.answer(stop), version == 5 ? Status::kEmergencyAborted : Status::kRejectedDueToActivatedSafetyFunctions);
  }
}

TEST(Motion, OfAClientThatHasGoneEndsInAReflexThatTheNextOneFinds) {
  DrivenArm arm("fr3", lockstep());
  {
    RawClient client(arm, 10);
    client.start({});
    const auto start = client.state;
    client.drive(kCycles / 2, [&](int cycle) { return reference(start, cycle); });
  }
  RawClient next(arm, 10);
  EXPECT_EQ(next.state.robot_mode, RobotMode::kReflex);
  EXPECT_TRUE(next.state.errors[static_cast<std::size_t>(Error::kCommunicationConstraints)]);
  EXPECT_EQ(next.ask(fci::AutomaticErrorRecovery{}), Status::kSuccess);
  EXPECT_TRUE(RawClient::idle(next.fresh()));
}

TEST(Motion, InLockstepIsTheSameEveryTime) {
  std::array<std::vector<TruthRow>, 2> runs;
  for (auto& rows : runs) {
    const std::string file = testing::TempDir() + "lockstep-truth-" + std::to_string(::getpid()) + ".npy";
    {
      DrivenArm arm("fr3", lockstep(), file);
      RawClient client(arm, 10);
      client.start({.controller_mode = ControllerMode::kCartesianImpedance,
                    .motion_generator_mode = Mode::kCartesianPosition});
      const fci::RobotState start = client.state;
      client.drive(2 * kCycles, [&](int cycle) { return reference(start, cycle); });
      EXPECT_EQ(client.finish(reference(start, kCycles)), Status::kSuccess);
    }
    rows = read_truth(file);
    std::filesystem::remove(file);
  }
  ASSERT_GE(runs[0].size(), 2u * kCycles);
  ASSERT_EQ(runs[0].size(), runs[1].size());
  for (std::size_t i = 0; i < runs[0].size(); ++i) {
    for (int j = 0; j < 7; ++j) ASSERT_EQ(runs[0][i].q[j], runs[1][i].q[j]) << "cycle " << i;
  }
}

TEST(Motion, TheArmFeelsWhatItCarries) {
  DrivenArm arm;
  RawClient client(arm, 10);
  EXPECT_EQ(client.ask(fci::SetLoad{1, {0, 0, 0.1034}, {}}), Status::kSuccess);
  // It believes to carry a kilogram that is not there, and so is pushed up by its own compensation: about 9.81 N.
  for (int i = 0; i < 1000; ++i) client.receive();
  EXPECT_NEAR(client.state.O_F_ext_hat_K[2], -9.81, 0.8);
  EXPECT_NEAR(client.state.O_F_ext_hat_K[0], 0, 0.8);
  EXPECT_TRUE(client.state.K_F_ext_hat_K[2] > 8);
}

}  // namespace
