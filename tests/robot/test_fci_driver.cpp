#include "robot/fci_driver.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <future>

#include "scripted_server.hpp"

namespace {

using namespace std::chrono_literals;
using robot::FciDriver;
using robot::Received;
using testing_tools::Bytes;
using testing_tools::ScriptedRobot;

// Where no time is looked at: a computer that stands still for a while is no robot that does not answer.
constexpr robot::FciTimes kPatient{20s, 20s, 20s};

// What connect() says when it throws.
std::string refusal(const std::string& address, const robot::FciTimes& times = kPatient) {
  try {
    FciDriver::connect(address, times);
  } catch (const robot::ConnectError& error) {
    return error.what();
  }
  ADD_FAILURE() << "connected";
  return "";
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

// Runs the robot's side while the client connects.
template <class Script>
std::unique_ptr<FciDriver> connect(ScriptedRobot& robot, Script script, const robot::FciTimes& times = kPatient) {
  auto side = std::async(std::launch::async, script);
  auto driver = FciDriver::connect(robot.address(), times);
  side.get();
  return driver;
}
template <class Script>
std::string refusal(ScriptedRobot& robot, Script script, const robot::FciTimes& times = kPatient) {
  auto side = std::async(std::launch::async, script);
  const std::string text = refusal(robot.address(), times);
  side.get();
  return text;
}

class EachVersion : public testing::TestWithParam<fci::Version> {
 protected:
  ScriptedRobot robot{GetParam()};

  std::unique_ptr<FciDriver> connected() {
    return connect(robot, [this] {
      if (robot.version != fci::kNewestVersion) {
        EXPECT_EQ(robot.take_connect(1, robot.version), fci::kNewestVersion);
      }
      robot.serve_connect();
    });
  }
};
INSTANTIATE_TEST_SUITE_P(FciDriver, EachVersion, testing::Range<fci::Version>(5, 11));

TEST_P(EachVersion, AsksTheRobotForItsVersionAndSpeaksIt) {
  const auto driver = connected();
  EXPECT_EQ(driver->version(), GetParam());
  EXPECT_EQ(driver->robot_model(), GetParam() >= 8 ? "<robot/>" : "");
}

TEST_P(EachVersion, StatesComeAndCommandsGo) {
  robot.state.q[3] = -1.5;
  const auto driver = connected();
  EXPECT_EQ(driver->first_state().q[3], -1.5);
  fci::RobotState state;
  for (int i = 0; i < 5; ++i) {
    robot.state.q[0] = 0.25 * i;
    robot.send_state();
    ASSERT_EQ(driver->receive(state), Received::kState);
    EXPECT_EQ(state.q[0], 0.25 * i);
    EXPECT_EQ(state.message_id, robot.state.message_id - 1);
    fci::RobotCommand command;
    command.message_id = state.message_id;
    command.tau_J_d[6] = 0.1 * i;
    command.motion_generation_finished = i == 4;
    command.torque_command_finished = true;
    driver->send(command);
    const fci::RobotCommand read = robot.command();
    EXPECT_EQ(read.message_id, state.message_id);
    EXPECT_EQ(read.tau_J_d[6], 0.1 * i);
    EXPECT_EQ(read.motion_generation_finished, i == 4);
    EXPECT_EQ(read.torque_command_finished, GetParam() >= 7);
  }
}

TEST_P(EachVersion, RequestsCarryTheVersionsIdsAndAnswersItsStatuses) {
  const auto driver = connected();
  fci::SetLoad load;
  load.m_load = 1.25;
  fci::Move move;
  move.controller_mode = fci::ControllerMode::kExternal;
  move.motion_generator_mode = fci::MotionGeneratorMode::kCartesianVelocity;
  for (const robot::Request& request :
       std::initializer_list<robot::Request>{move, fci::StopMove{}, fci::AutomaticErrorRecovery{}, load,
                                             fci::SetJointImpedance{}, fci::SetCartesianImpedance{},
                                             fci::SetCollisionBehavior{}, fci::SetEEToK{}, fci::SetNEToEE{}}) {
    const fci::Command name = std::visit([](const auto& r) { return r.kCommand; }, request);
    const auto id = driver->post(request);
    ASSERT_TRUE(id);
    const auto seen = robot.request();
    EXPECT_EQ(seen.command, name);
    EXPECT_EQ(seen.header.command_id, *id);
    if (name == fci::Command::kMove) {
      fci::Move read;
      ASSERT_TRUE(fci::read(robot.version, seen.body, read));
      EXPECT_EQ(seen.body.size(), robot.version >= 10 ? 113u : 56u);
      EXPECT_EQ(read.controller_mode, move.controller_mode);
      EXPECT_EQ(read.motion_generator_mode, move.motion_generator_mode);
    }
    if (name == fci::Command::kSetLoad) {
      fci::SetLoad read;
      ASSERT_TRUE(fci::read(robot.version, seen.body, read));
      EXPECT_EQ(read, load);
    }
    for (const fci::Status status : fci::statuses(robot.version, name)) {
      // Each request is answered once, but for a Move that has started.
      const auto open = status == fci::statuses(robot.version, name).front() ? id : driver->post(request);
      ASSERT_TRUE(open);
      if (open != id) robot.request();
      robot.answer(*open, name, status);
      std::optional<robot::Answer> answer;
      while (!answer && driver->lost() == nullptr) answer = driver->poll();
      ASSERT_TRUE(answer);
      EXPECT_EQ(answer->id, *open);
      EXPECT_EQ(answer->command, name);
      EXPECT_EQ(answer->status, status);
    }
  }
}

TEST_P(EachVersion, DropsAndCountsWhatIsNoState) {
  const auto driver = connected();
  const auto& counters = driver->counters();
  fci::RobotState state;
  const auto comes_through = [&] {
    robot.state.q[1] += 0.5;
    robot.send_state();
    ASSERT_EQ(driver->receive(state), Received::kState);
    EXPECT_EQ(state.q[1], robot.state.q[1]);
  };
  comes_through();

  Bytes bytes = robot.datagram();
  bytes.pop_back();
  robot.send_datagram(bytes);
  comes_through();
  EXPECT_EQ(counters.wrong_size, 1u);

  bytes = robot.datagram();
  bytes.resize(bytes.size() + 1);
  robot.send_datagram(bytes);
  bytes.resize(4000);
  robot.send_datagram(bytes);
  robot.send_datagram(Bytes(3));
  robot.send_datagram({});
  comes_through();
  EXPECT_EQ(counters.wrong_size, 5u);

  for (const double bad : {std::nan(""), double(INFINITY), -double(INFINITY)}) {
    for (double* field : {&robot.state.q[0], &robot.state.O_T_EE[15], &robot.state.control_command_success_rate}) {
      const double good = std::exchange(*field, bad);
      robot.send_state();
      *field = good;
    }
  }
  comes_through();
  EXPECT_EQ(counters.bad_values, 9u);

  robot.state.robot_mode = static_cast<fci::RobotMode>(77);
  robot.send_state();
  robot.state.robot_mode = fci::RobotMode::kIdle;
  comes_through();
  EXPECT_EQ(counters.bad_values, 10u);

  robot.state.message_id -= 2;  // seen already
  robot.send_state();
  robot.state.message_id += 2;
  comes_through();
  EXPECT_EQ(counters.old, 1u);

  // Loopback addresses are all ours: a stranger sends from another.
  robot.send_datagram_from("127.0.0.1", robot.datagram());
  comes_through();
  EXPECT_EQ(counters.foreign, 1u);
}

// In which of its numbers a state can do without one, as nobody computes with them.
TEST_P(EachVersion, ANumberThatNobodyUsesCostsNoState) {
  const auto driver = connected();
  fci::RobotState state;
  std::uint64_t dropped = 0;
  const auto arrives = [&](double& field) {
    const double good = std::exchange(field, std::nan(""));
    robot.send_state();
    field = good;
    robot.send_state();
    // The first of the two, or where that was dropped the second; the newest where both were there.
    const auto before = driver->counters().bad_values.load();
    EXPECT_EQ(driver->receive(state), Received::kState);
    while (state.message_id != robot.state.message_id - 1) EXPECT_EQ(driver->receive(state), Received::kState);
    return driver->counters().bad_values == before;
  };
  fci::RobotState& s = robot.state;
  for (double* used : {&s.q[6], &s.dq[0], &s.q_d[1], &s.dq_d[2], &s.ddq_d[3], &s.tau_J_d[4], &s.tau_ext_hat_filtered[5], &s.O_T_EE[12],
                       &s.O_T_EE_c[0], &s.F_T_EE[14], &s.EE_T_K[13], &s.O_F_ext_hat_K[2], &s.K_F_ext_hat_K[1], &s.O_ddP_O[0], &s.m_ee,
                       &s.I_ee[0], &s.F_x_Cee[1], &s.m_load, &s.I_load[8], &s.F_x_Cload[2], &s.joint_contact[0], &s.cartesian_contact[5],
                       &s.joint_collision[6], &s.cartesian_collision[0], &s.control_command_success_rate}) {
    EXPECT_FALSE(arrives(*used));
    EXPECT_EQ(driver->counters().bad_values, ++dropped);
  }
  for (double* unused : {&s.tau_J[0], &s.dtau_J[6], &s.theta[3], &s.dtheta[3], &s.elbow[0], &s.elbow_d[1], &s.elbow_c[0], &s.delbow_c[0],
                         &s.ddelbow_c[1], &s.O_T_EE_d[3], &s.F_T_NE[0], &s.NE_T_EE[5], &s.O_dP_EE_d[0], &s.O_dP_EE_c[1], &s.O_ddP_EE_c[5],
                         &s.accelerometer_top[0], &s.accelerometer_bottom[17]}) {
    EXPECT_TRUE(arrives(*unused));
  }
  EXPECT_EQ(driver->counters().text(), "25 states with values that are no numbers, or unknown modes");
}

class Driver : public testing::Test {
 protected:
  ScriptedRobot robot{10};
  std::unique_ptr<FciDriver> driver;
  fci::RobotState state;

  void connect_driver(std::chrono::milliseconds silence = kPatient.silence) {
    driver = connect(robot, [this] { robot.serve_connect(); }, {kPatient.connect, kPatient.model, silence});
  }
  // Answers in the order in which they arrive, until there are so many.
  std::vector<robot::Answer> answers(std::size_t count) {
    std::vector<robot::Answer> found;
    while (found.size() < count && driver->lost() == nullptr) {
      if (const auto answer = driver->poll()) found.push_back(*answer);
    }
    return found;
  }
};

TEST_F(Driver, KeepsTheNewestOfSeveralStates) {
  connect_driver();
  for (int i = 0; i < 40; ++i) robot.send_state();
  ASSERT_EQ(driver->receive(state), Received::kState);
  EXPECT_EQ(state.message_id, robot.state.message_id - 1);
}

TEST_F(Driver, TakesTheNewestWhenDatagramsOvertakeEachOther) {
  connect_driver();
  const Bytes first = robot.datagram();
  ++robot.state.message_id;
  robot.send_state();
  robot.send_datagram(first);
  ASSERT_EQ(driver->receive(state), Received::kState);
  EXPECT_EQ(state.message_id, robot.state.message_id - 1);
  EXPECT_EQ(driver->counters().old, 1u);
}

TEST_F(Driver, AnswersTheAddressThatTheLastStateCameFrom) {
  connect_driver();
  robot.send_datagram_from(robot.address(), robot.datagram());
  ASSERT_EQ(driver->receive(state), Received::kState);
  fci::RobotCommand command;
  command.message_id = state.message_id;
  driver->send(command);
  EXPECT_EQ(robot.command(true).message_id, state.message_id);
}

TEST_F(Driver, PutsHalvesOfResponsesTogether) {
  connect_driver();
  const auto id = driver->post(fci::SetEEToK{});
  robot.request();
  const Bytes bytes = robot.response(*id, fci::Command::kSetEEToK, fci::Status::kSuccess);
  for (std::size_t i = 0; i + 1 < bytes.size(); ++i) {
    robot.write(std::span(bytes).subspan(i, 1));
    std::this_thread::sleep_for(1ms);
    EXPECT_FALSE(driver->poll());
  }
  robot.write(std::span(bytes).last(1));
  const auto found = answers(1);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].status, fci::Status::kSuccess);
}

TEST_F(Driver, TakesSeveralResponsesAtOnceAndPadding) {
  connect_driver();
  Bytes all;
  std::vector<std::uint32_t> ids;
  for (int i = 0; i < 5; ++i) {
    ids.push_back(*driver->post(fci::SetEEToK{}));
    robot.request();
    const Bytes one = robot.response(ids.back(), fci::Command::kSetEEToK,
                                     i == 3 ? fci::Status::kInvalidArgument : fci::Status::kSuccess, 2000 * i);
    all.insert(all.end(), one.begin(), one.end());
  }
  robot.write(all);
  const auto found = answers(5);
  ASSERT_EQ(found.size(), 5u);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(found[i].id, ids[i]);
    EXPECT_EQ(found[i].status, i == 3 ? fci::Status::kInvalidArgument : fci::Status::kSuccess);
  }
}

TEST_F(Driver, NoticesATcpCloseWhileStatesFlow) {
  connect_driver();
  robot.hang_up();
  while (driver->lost() == nullptr) driver->poll();
  EXPECT_EQ(driver->receive(state), Received::kLost);
  EXPECT_FALSE(driver->post(fci::StopMove{}));
}

TEST_F(Driver, NoticesATcpCloseWhileNothingComes) {
  connect_driver(2s);  // in which it looks ten times
  robot.hang_up();
  EXPECT_EQ(driver->receive(state), Received::kLost);
}

TEST_F(Driver, WaitsForASilentRobotAsLongAsItIsTold) {
  connect_driver(100ms);
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(driver->receive(state), Received::kNothing);
  EXPECT_GE(std::chrono::steady_clock::now() - start, 100ms);
  EXPECT_EQ(driver->lost(), nullptr);
}

// --- a robot that is not as it should be ----------------------------------------------------------

TEST_F(Driver, AnswersThatNobodyAskedForArePassedOver) {
  connect_driver();
  const auto move = driver->post(fci::Move{});
  robot.request();
  const auto load = driver->post(fci::SetLoad{});
  robot.request();
  ASSERT_TRUE(move && load);
  robot.answer(*load + 7, fci::Command::kSetLoad, fci::Status::kSuccess);  // of a request that was not made
  robot.answer(*load, fci::Command::kMove, fci::Status::kSuccess);         // of one, under another's name
  robot.answer(0, fci::Command::kMove, fci::Status::kSuccess);
  robot.answer(*move, fci::Command::kMove, fci::Status::kMotionStarted);
  robot.answer(*load, fci::Command::kSetLoad, fci::Status::kInvalidArgument);
  robot.answer(*load, fci::Command::kSetLoad, fci::Status::kSuccess);  // twice
  robot.answer(*move, fci::Command::kMove, fci::Status::kSuccess);
  robot.answer(*move, fci::Command::kMove, fci::Status::kSuccess);
  const auto stop = driver->post(fci::StopMove{});
  robot.request();
  robot.answer(*stop, fci::Command::kStopMove, fci::Status::kSuccess);
  const auto found = answers(4);
  ASSERT_EQ(found.size(), 4u);
  EXPECT_EQ(found[0].status, fci::Status::kMotionStarted);
  EXPECT_EQ(found[1].id, *load);
  EXPECT_EQ(found[1].status, fci::Status::kInvalidArgument);
  EXPECT_EQ(found[2].id, *move);
  EXPECT_EQ(found[3].id, *stop);
  EXPECT_EQ(driver->counters().unasked, 5u);
  EXPECT_EQ(driver->counters().text(), "5 answers that nobody had asked for");
  EXPECT_EQ(driver->lost(), nullptr);
}

TEST_F(Driver, AnAnswerThatComesLateIsAnAnswer) {
  connect_driver();
  const auto id = driver->post(fci::SetLoad{});
  robot.request();
  for (int i = 0; i < 3000; ++i) {  // three seconds of the robot's time
    robot.state.message_id += 1;
    if (i % 100 == 0) robot.send_state();
    EXPECT_FALSE(driver->poll());
  }
  robot.answer(*id, fci::Command::kSetLoad, fci::Status::kSuccess);
  const auto found = answers(1);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].id, *id);
}

TEST_F(Driver, RequestsThatAreNeverAnsweredAreForgotten) {
  connect_driver();
  const auto first = driver->post(fci::SetLoad{});
  robot.request();
  std::optional<std::uint32_t> last;
  for (int i = 0; i < 64; ++i) {
    ASSERT_TRUE(last = driver->post(fci::SetLoad{}));
    robot.request();
  }
  robot.answer(*first, fci::Command::kSetLoad, fci::Status::kSuccess);
  robot.answer(*last, fci::Command::kSetLoad, fci::Status::kSuccess);
  const auto found = answers(1);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].id, *last);
  EXPECT_EQ(driver->counters().unasked, 1u);
}

TEST_F(Driver, StatesThatRepeatOrGoBackArePassedOver) {
  connect_driver(100ms);
  robot.send_state();
  ASSERT_EQ(driver->receive(state), Received::kState);
  const auto newest = state.message_id;
  robot.state.message_id = newest;  // again
  robot.send_state();
  robot.state.message_id = 1;  // a robot that was started anew, say
  robot.send_state();
  robot.send_state();
  EXPECT_EQ(driver->receive(state), Received::kNothing);
  EXPECT_EQ(driver->counters().old, 3u);
  EXPECT_EQ(driver->counters().text(), "3 states that were not newer than the last");
  robot.state.message_id = newest + 1;
  robot.send_state();
  ASSERT_EQ(driver->receive(state), Received::kState);
  EXPECT_EQ(state.message_id, newest + 1);
}

TEST_F(Driver, GarbageOverTcpLosesTheConnection) {
  for (const int kind : {0, 1, 2}) {
    ScriptedRobot garbled(10);
    driver = connect(garbled, [&] { garbled.serve_connect(); });
    Bytes bytes = garbled.response(1, fci::Command::kSetEEToK, fci::Status::kSuccess);
    if (kind == 0) bytes.assign(100, std::byte{0xAB});
    if (kind == 1) bytes[8] = std::byte{5};  // size
    if (kind == 2) bytes[fci::kHeaderSize] = std::byte{99};  // status
    driver->post(fci::SetEEToK{});
    garbled.write(bytes);
    answers(1);
    ASSERT_NE(driver->lost(), nullptr);
    EXPECT_TRUE(contains(driver->lost(), "garbage"));
    EXPECT_EQ(driver->receive(state), Received::kLost);
  }
}

TEST_F(Driver, RefusesRequestsThatTheConnectionCannotTake) {
  connect_driver();
  std::optional<std::uint32_t> id;
  int taken = 0;
  do {
    id = driver->post(fci::SetCollisionBehavior{});
    ++taken;
  } while (id && taken < 1'000'000);
  EXPECT_FALSE(id) << "nobody reads";
  EXPECT_GT(taken, 10);
  EXPECT_EQ(driver->lost(), nullptr);
  for (int i = 1; i < taken; ++i) {  // what was taken arrives whole
    driver->poll();
    const auto request = robot.request();
    ASSERT_EQ(request.command, fci::Command::kSetCollisionBehavior);
    ASSERT_EQ(request.header.command_id, static_cast<std::uint32_t>(i + 1));
  }
}

// --- refusals of connect() ----------------------------------------------------------------------

TEST(FciDriverConnect, SaysThatNobodyIsThere) {
  ScriptedRobot robot(10);
  robot.stop_listening();
  const std::string text = refusal(robot.address());
  EXPECT_TRUE(contains(text, robot.address() + ", TCP port 1337 refused")) << text;
  EXPECT_TRUE(contains(text, "FCI is activated")) << text;
}

TEST(FciDriverConnect, SaysThatANameIsUnknown) {
  const std::string text = refusal("no-such-robot.invalid");
  EXPECT_TRUE(contains(text, "\"no-such-robot.invalid\"")) << text;
  EXPECT_TRUE(contains(text, "cannot be resolved")) << text;
}

TEST(FciDriverConnect, NamesAVersionThatItDoesNotSpeak) {
  for (const std::uint16_t version : {3, 4, 11}) {
    ScriptedRobot robot(10);
    const std::string text = refusal(robot, [&] { robot.take_connect(1, version); });
    EXPECT_TRUE(contains(text, "speaks protocol version " + std::to_string(version))) << text;
    EXPECT_TRUE(contains(text, "5 to 10")) << text;
  }
}

TEST(FciDriverConnect, DoesNotAskForEverARobotThatRefusesItsOwnVersion) {
  ScriptedRobot robot(6);
  const std::string text = refusal(robot, [&] {
    robot.take_connect(1, 6);
    robot.take_connect(1, 7);
  });
  EXPECT_TRUE(contains(text, "refused version 6")) << text;

  ScriptedRobot newest(10);
  const std::string same = refusal(newest, [&] { newest.take_connect(1, 10); });
  EXPECT_TRUE(contains(same, "refused version 10")) << same;
}

TEST(FciDriverConnect, SaysThatAnotherClientMayHaveTheRobot) {
  ScriptedRobot closing(10);
  std::string text = refusal(closing, [&] {
    closing.accept();
    closing.read(16);
    closing.hang_up();
  });
  EXPECT_TRUE(contains(text, "Another client may have it")) << text;

  ScriptedRobot silent(10);  // listens, and never accepts
  text = refusal(silent.address(), {.connect = 200ms});
  EXPECT_TRUE(contains(text, "Another client may have it")) << text;
}

TEST(FciDriverConnect, SaysThatWhatAnswersIsNoRobot) {
  ScriptedRobot robot(10);
  const std::string text = refusal(robot, [&] {
    robot.accept();
    robot.read(16);
    const std::string http = "HTTP/1.1 400 Bad Request\r\n\r\n";
    robot.write(std::as_bytes(std::span(http)));
  });
  EXPECT_TRUE(contains(text, "is no robot")) << text;
}

TEST(FciDriverConnect, SaysThatNoStatesArrive) {
  ScriptedRobot robot(10);
  std::string text = refusal(robot, [&] { robot.take_connect(0, 10); }, {.connect = 5s});
  EXPECT_TRUE(contains(text, "no states arrive")) << text;
  EXPECT_TRUE(contains(text, "firewall")) << text;

  ScriptedRobot other(10);
  text = refusal(other, [&] {
    other.take_connect(0, 10);
    other.send_datagram(Bytes(1376));
  }, {.connect = 5s});
  EXPECT_TRUE(contains(text, "received datagrams of 1376 bytes")) << text;
}

TEST(FciDriverConnect, BelievesTheSizeOfTheStatesAndNotTheAnswer) {
  ScriptedRobot floats(10);  // names a version that does not exist
  EXPECT_EQ(connect(floats, [&] {
              floats.take_connect(0, 2560);
              floats.serve_rest();
            })->version(),
            10);
  ScriptedRobot doubles(9);  // takes any, and says its own
  EXPECT_EQ(connect(doubles, [&] {
              doubles.take_connect(0, 9);
              doubles.serve_rest();
            })->version(),
            9);
  ScriptedRobot contradicting(9);
  const std::string text = refusal(contradicting, [&] {
    contradicting.take_connect(0, 10);
    contradicting.send_state();
  });
  EXPECT_TRUE(contains(text, "contradicts itself")) << text;
  EXPECT_TRUE(contains(text, "2373 bytes")) << text;
}

TEST(FciDriverConnect, WorksWithARobotThatHasNoModelToGive) {
  ScriptedRobot robot(10);
  const auto driver = connect(robot, [&] {
    robot.take_connect(0, 10);
    robot.send_state();
    const auto asked = robot.request();
    robot.answer(asked.header.command_id, fci::Command::kGetRobotModel, fci::Status::kFailed);
  });
  EXPECT_EQ(driver->robot_model(), "");
}

}  // namespace
