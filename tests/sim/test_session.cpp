// Connecting to the simulated arm, its requests and their answers, and what is no client at all.

#include <sched.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <thread>

#include "models/arm.hpp"
#include "raw_client.hpp"
#include "sim/model_library/model_library.hpp"
#include "simulated_arm.hpp"

namespace {

using namespace testing_tools;
using fci::Command;
using fci::ControllerMode;
using fci::RobotMode;
using fci::Status;
using Mode = fci::MotionGeneratorMode;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class EveryVersion : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Protocol, EveryVersion, testing::Range(5, 11));

// An arm whose systems spoke that version.
const char* arm_of(int version) { return version <= 5 ? "fer" : "fr3"; }

TEST_P(EveryVersion, IsAnsweredInItself) {
  DrivenArm arm(arm_of(GetParam()));
  RawClient client(arm, GetParam());
  EXPECT_EQ(client.connect_answer.header.command, 0u);
  EXPECT_EQ(client.connect_answer.header.size, 15u);
  EXPECT_EQ(client.connect_answer.status, 0);
  ASSERT_EQ(client.connect_answer.body.size(), 2u);
  EXPECT_EQ(std::to_integer<int>(client.connect_answer.body[0]), GetParam());

  auto last = client.state.message_id;
  for (int i = 0; i < 20; ++i) {
    client.receive();
    EXPECT_EQ(client.state.message_id, last + 1);
    last = client.state.message_id;
  }
  EXPECT_TRUE(RawClient::idle(client.state));
  for (int i = 0; i < 7; ++i) EXPECT_NEAR(client.state.q[i], models::kHome[i], 0.01);
  EXPECT_EQ(client.state.O_ddP_O[2], GetParam() == 10 ? -9.81f : -9.81);
  EXPECT_FALSE(fci::any(client.state.errors));
}

TEST_P(EveryVersion, HasEachOfItsRequests) {
  DrivenArm arm(arm_of(GetParam()));
  RawClient client(arm, GetParam());
  const auto expect = [&](std::uint32_t id, std::uint32_t command, std::uint32_t size) {
    const auto response = client.response();
    EXPECT_EQ(response.header.command, command);
    EXPECT_EQ(response.header.command_id, id);
    if (size > 0) {
      EXPECT_EQ(response.header.size, size) << "command " << command;
    }
    EXPECT_EQ(response.status, 0) << "command " << command;
    return response;
  };
  const bool old = GetParam() <= 5;
  const std::uint32_t first = old ? 4 : 3;
  expect(client.post(thresholds(20, 20)), first, 13);
  expect(client.post(fci::SetJointImpedance{}), first + 1, 13);
  expect(client.post(fci::SetCartesianImpedance{{10, 10, 10, 1, 1, 1}}), first + 2, 13);
  expect(client.post(fci::SetGuidingMode{}), first + 3, 13);
  expect(client.post(fci::SetEEToK{}), first + 4, 13);
  expect(client.post(fci::SetNEToEE{}), first + 5, 13);
  expect(client.post(fci::SetLoad{}), first + 6, 13);
  expect(client.post(fci::StopMove{}), 2, 13);
  expect(client.post(fci::AutomaticErrorRecovery{}), old ? 12 : 10, 13);
  if (old) {
    const auto limit = expect(client.post(fci::GetCartesianLimit{}), 3, 12 + 154);
    EXPECT_EQ(limit.body.back(), std::byte{0});  // not activated
    expect(client.post(fci::SetFilters{}), 11, 13);
  }
  if (GetParam() <= 9) {
    const auto library = expect(client.post(fci::LoadModelLibrary{}), old ? 13 : 11, 0);
    EXPECT_TRUE(std::ranges::equal(library.body, sim::model_library(arm_of(GetParam()), {})));
    EXPECT_GT(library.body.size(), 10'000u);
  }
  if (GetParam() >= 8) {
    const auto model = expect(client.post(fci::GetRobotModel{}), GetParam() == 10 ? 11 : 12, 0);
    const std::string urdf(reinterpret_cast<const char*>(model.body.data()), model.body.size());
    EXPECT_EQ(urdf, models::urdf(models::arm("fr3"), static_cast<fci::Version>(GetParam())));
  }
}

TEST(Session, VersionsThatItsSystemsHaveNotSpokenAreRefusedWithTheNearest) {
  struct Case {
    const char* robot;
    std::vector<std::pair<int, int>> refused;  // asked, answered
    std::vector<int> spoken;
  };
  const std::vector<Case> cases = {
      {"fer", {{0, 5}, {4, 5}, {6, 5}, {10, 5}, {65535, 5}}, {5}},
      {"fr3", {{0, 6}, {5, 6}, {11, 10}, {65535, 10}}, {6, 7, 8, 9, 10}},
  };
  for (const Case& arms : cases) {
    DrivenArm arm(arms.robot);
    for (const auto& [asked, answered] : arms.refused) {
      RawClient client(arm, static_cast<fci::Version>(asked));
      EXPECT_EQ(client.connect_answer.status, 1) << arms.robot << " " << asked;
      EXPECT_EQ(std::to_integer<int>(client.connect_answer.body[0]), answered);
      EXPECT_TRUE(client.sockets.closed());
    }
    for (const int version : arms.spoken) {
      EXPECT_EQ(RawClient(arm, static_cast<fci::Version>(version)).connect_answer.status, 0);
    }
  }
}

TEST(Session, AnArmOfOneVersionRefusesAllOthers) {
  sim::Cell::Options options;
  options.version = 7;
  DrivenArm arm("fr3", options);
  for (int version : {5, 6, 8, 9, 10}) {
    RawClient client(arm, static_cast<fci::Version>(version));
    EXPECT_EQ(client.connect_answer.status, 1);
    EXPECT_EQ(std::to_integer<int>(client.connect_answer.body[0]), 7);
  }
  EXPECT_EQ(RawClient(arm, 7).connect_answer.status, 0);
}

// A client without power says no goodbye. The kernel tells of a connection's timers, of which 2 is that of keeping alive.
TEST(Session, IsKeptAlive) {
  DrivenArm arm;
  RawClient client(arm, 10);
  in_addr address{};
  ::inet_pton(AF_INET, arm.address().c_str(), &address);
  char own[16];
  std::snprintf(own, sizeof own, "%08X:%04X", address.s_addr, fci::kRobotPort);
  int found = 0;
  std::ifstream table("/proc/net/tcp");
  for (std::string line; std::getline(table, line);) {
    std::istringstream words(line);
    std::string number, local, remote, state, queues, timer;
    words >> number >> local >> remote >> state >> queues >> timer;
    if (local != own || state != "01") continue;
    ++found;
    EXPECT_EQ(timer.substr(0, 3), "02:");
    EXPECT_LE(std::stoul(timer.substr(3), nullptr, 16), 100u);  // of a hundredth of a second
  }
  EXPECT_EQ(found, 1);
}

TEST(Session, ASecondClientIsRefusedAtOnceAndTheNextServedWhenTheFirstHasGone) {
  DrivenArm arm;
  {
    RawClient first(arm, 10);
    EXPECT_THROW(RawClient(arm, 10), std::runtime_error);
    const auto before = first.newest().message_id;
    first.receive_until([&](const auto& state) { return state.message_id > before + 5; });
    EXPECT_EQ(first.ask(fci::SetJointImpedance{}), Status::kSuccess);
    EXPECT_NE(arm.log().find("only one client"), std::string::npos);
  }
  EXPECT_EQ(RawClient(arm, 6).connect_answer.status, 0);

  RawGripper first(arm);
  EXPECT_EQ(first.connect_status, fci::gripper::Status::kSuccess);
  EXPECT_THROW(RawGripper second(arm), std::runtime_error);
  EXPECT_EQ(first.ask(fci::gripper::Stop{}), fci::gripper::Status::kSuccess);
}

Bytes header(std::uint32_t command, std::uint32_t id, std::uint32_t size) {
  Bytes bytes(fci::kHeaderSize);
  fci::write(10, fci::Header{command, id, size}, bytes);
  return bytes;
}

TEST(Session, GarbageClosesItsConnectionAndNothingElse) {
  DrivenArm arm;
  for (const std::uint16_t port : {fci::kRobotPort, fci::gripper::kPort}) {
    for (const std::string& garbage :
         {std::string("GET / HTTP/1.1\r\n\r\n"), std::string(100'000, '\xff'), std::string(64, '\0')}) {
      RawSockets sockets(arm, port);
      sockets.write(garbage);
      EXPECT_TRUE(sockets.closed());
    }
    RawSockets half(arm, port);  // half a Connect, then silence
    half.write(std::string(7, '\0'));
    EXPECT_TRUE(half.closed());
  }
  // A client that is connected already.
  const std::vector<Bytes> messages = {header(99, 1, 12), header(0, 1, 16), header(1, 1, 4), header(1, 1, 0xffffffff),
                                       header(1, 1, 20)};
  for (const Bytes& message : messages) {
    RawClient client(arm, 10);
    client.sockets.write(message);
    client.sockets.write(std::string(8, '\0'));
    EXPECT_TRUE(client.sockets.closed());
  }
  {
    RawClient client(arm, 10);
    client.sockets.write(header(4, 1, 12 + 56));  // SetJointImpedance, without its figures
    client.receive();
    EXPECT_TRUE(client.sockets.closed());
  }
  {
    RawGripper gripper(arm);
    gripper.sockets.write(std::string("\x05\x00garbage!", 10));
    EXPECT_TRUE(gripper.sockets.closed());
  }
  RawClient client(arm, 10);
  EXPECT_EQ(client.ask(fci::SetJointImpedance{}), Status::kSuccess);
  EXPECT_EQ(RawGripper(arm).connect_status, fci::gripper::Status::kSuccess);
}

TEST(Session, ARequestMayComeInPieces) {
  DrivenArm arm;
  RawClient client(arm, 10);
  Bytes message = header(4, 1, 12 + 56);
  message.resize(12 + 56);
  for (std::size_t i = 0; i < message.size(); i += 20) {
    client.sockets.write(std::span(message).subspan(i, std::min<std::size_t>(20, message.size() - i)));
    client.receive();
    client.receive();
  }
  EXPECT_EQ(client.answer(1), Status::kSuccess);
}

TEST(Session, DatagramsThatAreNoCommandsAreIgnored) {
  DrivenArm arm("fr3", lockstep());
  RawClient client(arm, 10);
  client.start({.controller_mode = ControllerMode::kJointImpedance});
  const auto hold = client.hold();
  for (std::size_t size : {0, 1, 370, 372, 1377, 4000}) {
    client.sockets.send_datagram(Bytes(size, std::byte{0xff}));
    client.drive(1, [&](int) { return hold; });
  }
  EXPECT_EQ(client.finish(hold), Status::kSuccess);
}

TEST(Session, SettingsOutOfRangeAreRefused) {
  DrivenArm arm;
  RawClient client(arm, 10);
  for (double value : {-1., 14251., kNan, HUGE_VAL}) {
    EXPECT_EQ(client.ask(fci::SetJointImpedance{{3000, 3000, 3000, 2500, 2500, 2000, value}}), Status::kInvalidArgument);
  }
  EXPECT_EQ(client.ask(fci::SetJointImpedance{{0, 0, 0, 0, 0, 0, 14250}}), Status::kSuccess);
  EXPECT_EQ(client.ask(fci::SetCartesianImpedance{{9, 10, 10, 1, 1, 1}}), Status::kInvalidArgument);
  EXPECT_EQ(client.ask(fci::SetCartesianImpedance{{10, 10, 3001, 1, 1, 1}}), Status::kInvalidArgument);
  EXPECT_EQ(client.ask(fci::SetCartesianImpedance{{10, 10, 10, 0.5, 1, 1}}), Status::kInvalidArgument);
  EXPECT_EQ(client.ask(fci::SetCartesianImpedance{{10, 10, 10, 1, 1, kNan}}), Status::kInvalidArgument);
  fci::SetCollisionBehavior behavior;
  behavior.upper_force_thresholds_nominal[5] = kNan;
  EXPECT_EQ(client.ask(behavior), Status::kInvalidArgument);
  behavior.upper_force_thresholds_nominal[5] = -1;
  EXPECT_EQ(client.ask(behavior), Status::kInvalidArgument);
  fci::Pose bent = fci::kIdentityPose;
  bent[0] = 1.1;
  EXPECT_EQ(client.ask(fci::SetEEToK{bent}), Status::kInvalidArgument);
  EXPECT_EQ(client.ask(fci::SetNEToEE{bent}), Status::kInvalidArgument);
  fci::Pose mirrored = fci::kIdentityPose;
  mirrored[0] = -1;
  EXPECT_EQ(client.ask(fci::SetNEToEE{mirrored}), Status::kInvalidArgument);
  EXPECT_EQ(client.ask(fci::SetLoad{-0.1, {}, {}}), Status::kInvalidArgument);
  EXPECT_EQ(client.ask(fci::SetLoad{1, {kNan, 0, 0}, {}}), Status::kInvalidArgument);
  EXPECT_EQ(client.ask(fci::SetLoad{1, {}, {-1, 0, 0, 0, 1, 0, 0, 0, 1}}), Status::kInvalidArgument);
}

TEST(Session, SettingsAreInTheState) {
  DrivenArm arm;
  RawClient client(arm, 9);  // in float64
  const auto before = client.newest();
  fci::Pose shifted = fci::kIdentityPose;
  shifted[14] = 0.1;
  EXPECT_EQ(client.ask(fci::SetNEToEE{shifted}), Status::kSuccess);
  EXPECT_EQ(client.ask(fci::SetEEToK{shifted}), Status::kSuccess);
  EXPECT_EQ(client.ask(fci::SetLoad{0.5, {0, 0, 0.02}, {1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3}}), Status::kSuccess);
  const auto& after = client.fresh();
  EXPECT_EQ(after.NE_T_EE, shifted);
  EXPECT_EQ(after.EE_T_K, shifted);
  EXPECT_NEAR(after.F_T_EE[14], before.F_T_EE[14] + 0.1, 1e-12);
  EXPECT_NEAR(after.O_T_EE[14], before.O_T_EE[14] - 0.1, 1e-3);  // the tool points down
  EXPECT_EQ(after.m_load, 0.5);
  EXPECT_EQ(after.F_x_Cload[2], 0.02);
  EXPECT_NEAR(before.m_ee, 0.71, 0.05);  // of the hand
}

TEST(Session, MotionsThatNoVersionHasAreRefused) {
  for (int version = 5; version <= 10; ++version) {
    DrivenArm arm(arm_of(version));
    RawClient client(arm, static_cast<fci::Version>(version));
    using C = ControllerMode;
    const auto refused = [&](C controller, Mode generator) {
      EXPECT_EQ(client.ask(fci::Move{.controller_mode = controller, .motion_generator_mode = generator}),
                Status::kInvalidArgument)
          << "version " << version;
    };
    refused(C::kJointImpedance, Mode::kNone);
    refused(C::kCartesianImpedance, Mode::kNone);
    refused(C::kOther, Mode::kJointPosition);
    refused(C::kJointImpedance, static_cast<Mode>(77));
    if (version < 7) refused(C::kExternal, Mode::kNone);
    fci::Move nan;
    nan.maximum_path_deviation.rotation = kNan;
    EXPECT_EQ(client.ask(nan), Status::kInvalidArgument);
    const auto refused_asynchronous = [&](fci::Move move) {
      move.use_async_motion_generator = true;
      EXPECT_EQ(client.ask(move), Status::kInvalidArgument);
    };
    if (version == 10) {
      const fci::Vector7 slow = {0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5};
      refused_asynchronous({});
      refused_asynchronous({.motion_generator_mode = Mode::kJointVelocity, .maximum_velocity = slow});
      refused_asynchronous({.controller_mode = C::kExternal, .maximum_velocity = slow});
      for (const double velocity : {0., -0.5, 2.63, kNan}) {
        fci::Move move{.maximum_velocity = slow};
        move.maximum_velocity[3] = velocity;
        refused_asynchronous(move);
      }
    }
    EXPECT_TRUE(RawClient::idle(client.newest()));
  }
}

TEST(Session, DuringAMotionSettingsAndMotionsAreRefused) {
  DrivenArm arm("fr3", lockstep());
  RawClient client(arm, 10);
  client.start({});
  const auto hold = client.hold();
  const auto refused = [&](std::uint32_t id) {
    client.drive(2, [&](int) { return hold; });
    EXPECT_EQ(client.answer(id), Status::kNotPossible);
  };
  client.drive(1, [&](int) { return hold; });
  refused(client.post(fci::SetJointImpedance{}));
  refused(client.post(fci::SetCartesianImpedance{{10, 10, 10, 1, 1, 1}}));
  refused(client.post(fci::SetCollisionBehavior{}));
  refused(client.post(fci::SetEEToK{}));
  refused(client.post(fci::SetNEToEE{}));
  refused(client.post(fci::SetLoad{}));
  refused(client.post(fci::SetGuidingMode{}));
  refused(client.post(fci::AutomaticErrorRecovery{}));
  refused(client.post(fci::Move{}));
  EXPECT_EQ(client.finish(hold), Status::kSuccess);
  EXPECT_EQ(client.ask(fci::SetJointImpedance{}), Status::kSuccess);
}

// --- the program ----------------------------------------------------------------------------------------------------

TEST(WallTimeProgram, SaysWhatItIsWhenItIsReadyAndEndsCleanly) {
  SimulatedArm arm({"--robot", "fer", "--protocol", "5", "--lockstep"});
  EXPECT_NE(arm.ready_line().find("Panda"), std::string::npos);
  EXPECT_NE(arm.ready_line().find(arm.address() + ":1337"), std::string::npos);
  EXPECT_NE(arm.ready_line().find("protocol 5, lockstep"), std::string::npos);
  EXPECT_EQ(arm.terminate(), 0);
}

// Its threads' priorities, as the kernel has them.
std::vector<int> real_time_priorities(pid_t process) {
  std::vector<int> priorities;
  for (const auto& thread : std::filesystem::directory_iterator("/proc/" + std::to_string(process) + "/task")) {
    const pid_t id = std::stoi(thread.path().filename());
    sched_param parameters{};
    if ((::sched_getscheduler(id) & ~SCHED_RESET_ON_FORK) != SCHED_FIFO) continue;
    if (::sched_getparam(id, &parameters) == 0) priorities.push_back(parameters.sched_priority);
  }
  return priorities;
}

TEST(WallTimeProgram, TakesAPriorityAboveItsClientsWhereThatIsPermittedAndSaysSo) {
  const int highest = ::sched_get_priority_max(SCHED_FIFO);
  bool permitted = false;
  std::thread([&] {
    const sched_param parameters{.sched_priority = highest};
    permitted = ::sched_setscheduler(0, SCHED_FIFO, &parameters) == 0;
  }).join();
  {
    SimulatedArm arm({"--arms", "2"});
    const std::string said = arm.until_ready();
    EXPECT_NE(said.find(permitted ? "fci-sim: priority " + std::to_string(highest) : "no real-time priority"),
              std::string::npos)
        << said;
    RawClient client(arm.address(), 10);  // the arms' loops run
    const std::string next = arm.next_address();
    RawClient second(next, 10);
    EXPECT_EQ(real_time_priorities(arm.process()), std::vector<int>(permitted ? 2 : 0, highest));
  }
  SimulatedArm arm({"--lockstep"});
  EXPECT_EQ(arm.until_ready().find("priority"), std::string::npos);
  RawClient client(arm.address(), 10);
  EXPECT_TRUE(real_time_priorities(arm.process()).empty());
}

TEST(WallTimeProgram, RefusesInOneLineWhatItCannotDo) {
  SimulatedArm first;
  struct Case {
    std::vector<std::string> arguments;
    std::string address, says;
  };
  const std::vector<Case> cases = {
      {{}, first.address(), "is taken"},
      {{}, "192.0.2.1", "no address of this computer"},
      {{}, "robot.example", "no IPv4 address"},
      {{"--scene", "/nowhere.xml"}, free_address(), "/nowhere.xml"},
      {{"--truth", "/nowhere/truth.npy"}, free_address(), "/nowhere/truth.npy"},
      {{"--robot", "ur5"}, free_address(), "ur5"},
      {{"--protocol", "4"}, free_address(), "4"},
  };
  for (const Case& wrong : cases) {
    SimulatedArm arm(wrong.arguments, wrong.address);
    EXPECT_EQ(arm.ready_line(), "");
    EXPECT_NE(arm.wait(), 0);
    EXPECT_NE(arm.log().find(wrong.says), std::string::npos) << arm.log();
    EXPECT_LE(arm.log().size(), 400u);
  }
  EXPECT_TRUE(first.runs());
}

TEST(Pause, AMotionThatItsClientHasLeftThereIsOverForTheNext) {
  DrivenArm arm("fr3", lockstep(true));
  auto client = std::make_unique<RawClient>(arm, 10);
  client->start({});
  arm.cell().set_time(sim::Cell::Time::kPaused);
  client.reset();
  for (int n = 0; n < 20; ++n) arm.cycle();
  RawClient next(arm, 10);
  const std::uint64_t before = next.state.message_id;
  next.receive();
  EXPECT_GT(next.state.message_id, before);
  EXPECT_NE(next.state.robot_mode, fci::RobotMode::kMove);
}

}  // namespace
