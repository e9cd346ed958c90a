// Moments: what is restored goes on as it did, and what could not go on is refused.

#include <cmath>
#include <filesystem>
#include <functional>

#include "raw_client.hpp"
#include "truth.hpp"

namespace {

using namespace testing_tools;
using fci::RobotMode;
using fci::Status;
namespace gripper = fci::gripper;

constexpr int kSwayCycles = 300;

std::string refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

// A truth file's rows, without their first column, which counts cycles.
std::vector<std::string> rows_of(const std::string& path) {
  std::vector<std::string> rows = read_rows(path);
  for (std::string& row : rows) row.erase(0, sizeof(TruthRow::cycle));
  return rows;
}

// An arm that writes its truth, in lockstep, and a client of it over a network that may be bad.
struct Moments : testing::Test {
  explicit Moments(sim::Cell::Time time = sim::Cell::Time::kRuns) {
    auto options = lockstep();
    options.scene = "table_with_block";
    options.time = time;
    arm.emplace("fr3", options, truth());
    client.emplace(*arm, 9);
  }
  ~Moments() override { std::filesystem::remove(truth()); }

  std::string truth() const { return testing::TempDir() + "moments-" + std::to_string(::getpid()) + ".npy"; }
  sim::Cell& cell() { return arm->cell(); }
  std::uint64_t newest() { return cell().robot(0).state().message_id; }

  // The newest state; it has been sent.
  void catch_up() {
    for (int i = 0; client->state.message_id != newest(); ++i) {
      ASSERT_LT(i, 10'000);
      client->sockets.datagram_there() ? void(client->receive()) : void(::usleep(1000));
    }
  }
  // One cycle; a command is sent when the last state came, as a client does who waits for states.
  void cycle(const std::function<fci::RobotCommand()>& make) {
    sim::Network network = cell().network(0);
    const bool sends = client->state.message_id == newest();
    if (sends) {
      client->send(make());
      network.to_arm();
    }
    arm->cycle();
    if (network.from_arm() == 0) catch_up();
  }
  // Holds the arm softly where `middle` is, and sways; it looks at the newest state that it has.
  void sway(const fci::RobotState& middle, int cycles) {
    for (int i = 0; i < cycles; ++i) {
      cycle([&] {
        fci::RobotCommand command;
        for (int joint = 0; joint < 7; ++joint) {
          const double stiffness = joint < 4 ? 50 : 10;
          command.tau_J_d[joint] = stiffness * (middle.q[joint] - client->state.q[joint]) -
                                   std::sqrt(stiffness) * client->state.dq[joint];
        }
        command.tau_J_d[6] += 0.3 * std::sin(0.02 * i);
        return command;
      });
    }
  }
  // Turns the last joint by 0.1 rad within 500 cycles: those of this motion.
  void go(int from, int to) {
    for (int i = from; i < to; ++i) {
      cycle([&] {
        fci::RobotCommand command;
        command.q_c = start.q_d;
        const double s = std::min(1., i / 500.);
        command.q_c[6] += 0.1 * s * s * s * (10 - 15 * s + 6 * s * s);
        return command;
      });
    }
  }
  std::size_t rows() { return cell().cycle() - first_cycle; }
  // The rows from `again` on are those from `begin` on.
  void expect_the_same(std::size_t begin, std::size_t again, std::size_t count) {
    client.reset();
    arm.reset();  // writes the rest
    const auto all = rows_of(truth());
    ASSERT_GE(all.size(), again + count);
    std::size_t different = 0;
    for (std::size_t i = 0; i < count; ++i) different += all[begin + i] != all[again + i];
    EXPECT_EQ(different, 0u);
  }

  std::optional<DrivenArm> arm;
  std::optional<RawClient> client;
  fci::RobotState start;  // that a motion began with
  const std::uint64_t first_cycle = 1;  // of the state before any
};

TEST_F(Moments, LeaveWhatClientsHaveSet) {
  const std::uint64_t moment = cell().save();
  fci::SetLoad load;
  load.m_load = 0.5;
  ASSERT_EQ(client->ask(load), Status::kSuccess);
  client->receive();
  cell().restore(moment);
  client->receive();
  client->receive();
  EXPECT_EQ(client->state.m_load, 0.5);
}

TEST_F(Moments, WithinAMotionTheSameCommandsGiveTheSameTruthWithTheSameLosses) {
  client->start(kTorque);
  start = client->state;
  cell().network(0).set({.loss = 0.1, .delayed = 0.1, .delay = 2'000'000}, {.loss = 0.1, .delayed = 0.05, .delay = 3'000'000}, 7);
  cell().world().move_object("block", {0.5, -0.3, 0.1, 1, 0, 0, 0});  // falls meanwhile
  sway(start, 50);
  cell().world().push({0, 8, 0, 0, 0, 0}, 0.1);
  while (client->state.message_id != newest()) sway(start, 1);
  const std::uint64_t moment = cell().save();
  const std::size_t begin = rows();
  const fci::RobotState saved = client->state;

  sway(start, kSwayCycles);
  EXPECT_LT(client->state.control_command_success_rate, 0.95);
  const std::uint64_t last = newest();

  cell().restore(moment);
  EXPECT_EQ(newest(), last + 1);
  catch_up();  // the state of the moment, at once
  EXPECT_EQ(client->state.q, saved.q);
  EXPECT_EQ(client->state.tau_J_d, saved.tau_J_d);
  EXPECT_EQ(client->state.robot_mode, RobotMode::kMove);
  EXPECT_EQ(client->state.control_command_success_rate, saved.control_command_success_rate);
  const std::size_t again = rows();
  sway(start, kSwayCycles);
  EXPECT_EQ(client->state.robot_mode, RobotMode::kMove);
  expect_the_same(begin, again, kSwayCycles);
}

TEST_F(Moments, TimeThatIsSpentInAPauseCostsTheNetworkNoDraw) {
  client->start(kTorque);
  start = client->state;
  cell().network(0).set({.loss = 0.1}, {.loss = 0.1}, 3);
  sway(start, 3);
  while (client->state.message_id != newest()) sway(start, 1);
  const std::uint64_t moment = cell().save();
  const std::size_t begin = rows();
  sway(start, kSwayCycles);
  cell().restore(moment);
  catch_up();
  cell().set_time(sim::Cell::Time::kPaused);
  for (int i = 0; i < 37; ++i) arm->cycle();
  cell().set_time(sim::Cell::Time::kRuns);
  const std::size_t again = rows();
  sway(start, kSwayCycles);
  expect_the_same(begin, again, kSwayCycles);
}

TEST_F(Moments, AReferenceGoesOnFromTheMomentOrIsADiscontinuity) {
  client->start({});
  start = client->state;
  go(0, 100);
  const std::uint64_t moment = cell().save();
  const std::size_t begin = rows();
  go(100, 100 + kSwayCycles);
  cell().restore(moment);
  catch_up();
  const std::size_t again = rows();
  go(100, 100 + kSwayCycles);
  EXPECT_EQ(client->state.robot_mode, RobotMode::kMove);
  // One that has not heard of it.
  cell().restore(moment);
  catch_up();
  go(100 + kSwayCycles, 102 + kSwayCycles);
  EXPECT_EQ(client->state.robot_mode, RobotMode::kReflex);
  EXPECT_EQ(client->answer(client->move_id), Status::kReflexAborted);
  expect_the_same(begin, again, kSwayCycles);
}

TEST_F(Moments, AreRefusedWhereTheClientCouldNotGoOn) {
  const std::uint64_t resting = cell().save();
  client->start({});
  start = client->state;
  go(0, 250);
  const std::uint64_t moving = cell().save();
  EXPECT_NE(refusal([&] { cell().restore(resting); }).find("end it before"), std::string::npos);
  const auto stop = client->post(fci::StopMove{});
  client->receive();
  client->receive();
  EXPECT_NE(refusal([&] { cell().restore(moving); }).find("is being stopped"), std::string::npos);
  EXPECT_NE(refusal([&] { cell().save(); }).find("is being stopped"), std::string::npos);
  EXPECT_EQ(client->answer(client->move_id), Status::kPreempted);
  EXPECT_EQ(client->answer(stop), Status::kSuccess);
  EXPECT_NE(refusal([&] { cell().restore(moving); }).find("no longer runs"), std::string::npos);
  cell().restore(resting);
  // Nor has the next motion anything to do with it.
  client->start(kTorque);
  EXPECT_NE(refusal([&] { cell().restore(moving); }).find("no longer runs"), std::string::npos);
}

TEST_F(Moments, AnArmWhoseClientHasGoneIsOneWithoutAMotion) {
  client->start(kTorque);
  const std::uint64_t moving = cell().save();
  client.reset();
  for (int i = 0; i < 100 && cell().robot(0).moving(); ++i) arm->cycle();
  EXPECT_NE(refusal([&] { cell().restore(moving); }).find("no longer runs"), std::string::npos);
  const std::uint64_t swinging = cell().save();  // nobody waits for its reflex
  for (int i = 0; i < 100; ++i) arm->cycle();
  cell().restore(swinging);
  client.emplace(*arm, 9);
  EXPECT_EQ(client->fresh().robot_mode, RobotMode::kReflex);
  EXPECT_EQ(client->ask(fci::AutomaticErrorRecovery{}), Status::kSuccess);
}

TEST_F(Moments, OfTheHandAbortWhatTheyDoNotKnow) {
  RawGripper hand(*arm);
  ASSERT_EQ(hand.ask(gripper::Move{0.02, 0.1}), gripper::Status::kSuccess);
  const std::uint64_t before = cell().save();
  const auto opens = hand.post(gripper::Move{0.07, 0.05});
  while (hand.newest().width < 0.03) {
  }
  const std::uint64_t opening = cell().save();
  const double width = cell().world().truth().finger[0];
  while (hand.newest().width < 0.05) {
  }
  cell().restore(opening);  // the same command goes on
  EXPECT_EQ(cell().world().truth().finger[0], width);
  EXPECT_EQ(hand.answer(opens), gripper::Status::kSuccess);
  EXPECT_NEAR(hand.fresh().width, 0.07, 0.001);

  const auto closes = hand.post(gripper::Move{0.01, 0.02});
  while (hand.newest().width > 0.06) {
  }
  cell().restore(before);
  EXPECT_EQ(hand.answer(closes), gripper::Status::kAborted);
  EXPECT_NEAR(hand.fresh().width, 0.02, 0.001);
}

TEST_F(Moments, TakeNoMoreThanTheirRoom) {
  for (std::size_t i = 0; i < sim::Cell::kMostMoments; ++i) cell().save();
  EXPECT_NE(refusal([&] { cell().save(); }).find("forget one first, the oldest is 1"), std::string::npos);
  cell().forget(1);
  const std::uint64_t next = cell().save();
  EXPECT_EQ(next, sim::Cell::kMostMoments + 1);  // a number means one moment for ever
  EXPECT_NE(refusal([&] { cell().restore(1); }).find("no moment 1"), std::string::npos);
  EXPECT_NE(refusal([&] { cell().forget(1); }).find("no moment 1"), std::string::npos);
  cell().restore(next);
}

// While nothing moves the world stands still, so that there is nothing else that could differ.
struct MomentsBetweenMotions : Moments {
  MomentsBetweenMotions() : Moments(sim::Cell::Time::kBetweenMotionsPaused) {}

  void make_motion() {
    client->start(kTorque);
    sway(home, kSwayCycles);
    // A finish flag may be lost as well.
    while (client->state.robot_mode == RobotMode::kMove) {
      cycle([] {
        fci::RobotCommand command;
        command.motion_generation_finished = command.torque_command_finished = true;
        return command;
      });
    }
    EXPECT_EQ(client->answer(client->move_id), Status::kSuccess);
  }
  const fci::RobotState home = client->state;
};

TEST_F(MomentsBetweenMotions, HoldTheNetworksDraw) {
  cell().network(0).set({.loss = 0.2}, {}, 11);
  make_motion();
  const std::uint64_t moment = cell().save();
  const std::size_t begin = rows();
  make_motion();
  const std::size_t made = rows() - begin;
  cell().restore(moment);
  const std::size_t again = rows();
  make_motion();
  EXPECT_EQ(rows() - again, made);
  expect_the_same(begin, again, made);
}

}  // namespace
