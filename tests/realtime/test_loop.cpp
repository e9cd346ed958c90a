#include "realtime/loop.hpp"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <ctime>
#include <deque>
#include <functional>
#include <numeric>
#include <random>
#include <utility>

#include "allocation_counter.hpp"
#include "at_home.hpp"
#include "mock_driver.hpp"
#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/controllers/joint_impedance.hpp"
#include "realtime/robot_controllers/robot_controller.hpp"
#include "realtime/terminations/composite.hpp"
#include "realtime/terminations/final_joint.hpp"
#include "realtime/trajectories/min_jerk_joint.hpp"
#include "realtime/trajectories/min_jerk_pose.hpp"
#include "realtime/trajectories/relative_min_jerk_joint.hpp"
#include "realtime/trajectories/stream_joint.hpp"
#include "realtime/trajectories/stream_velocity.hpp"
#include "walled.hpp"

namespace {

using namespace realtime;
using testing_tools::AllocationCounter;
using testing_tools::MockRobot;
using Generator = fci::MotionGeneratorMode;

constexpr auto kNow = std::numeric_limits<std::uint64_t>::max();  // whatever there is to recover from
constexpr robot::Mode kInternalJoint = {fci::ControllerMode::kJointImpedance, Generator::kJointPosition};
constexpr robot::Mode kInternalPose = {fci::ControllerMode::kCartesianImpedance, Generator::kCartesianPosition};

JointImpedance::Parameters gains(double scale = 1) {
  return {scale * (Vector7() << 600, 600, 600, 600, 250, 150, 50).finished(),
          std::sqrt(scale) * (Vector7() << 50, 50, 50, 50, 30, 25, 15).finished()};
}

// The robot's own controller.
struct Internal : Controller {
  Channels takes() const noexcept override { return Channels::kJoint | Channels::kPose; }
  robot::Mode mode(Channels kind) const noexcept override {
    return kind == Channels::kJoint ? kInternalJoint : kInternalPose;
  }
  void start(const Cycle&, Reference&) noexcept override {}
  void step(const Cycle&, const Reference&, Vector7&) noexcept override { ADD_FAILURE() << "has no torque"; }
};

// Spring and damper on the pose: enough of a controller to follow Cartesian references under torque control.
struct PoseSpring : Controller {
  Channels takes() const noexcept override { return Channels::kPose; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }
  void start(const Cycle&, Reference&) noexcept override {}
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau) noexcept override {
    Vector6 force;
    force.head<3>() = 600 * (reference.cartesian.position - cycle.O_T_EE.translation());
    force.tail<3>() =
        30 * realtime::log(reference.cartesian.orientation * Eigen::Quaterniond(cycle.O_T_EE.linear()).conjugate());
    tau = cycle.model.jacobian().transpose() * force - 10 * cycle.dq + cycle.model.coriolis();
  }
};

// Gives NaN from a time on.
struct BrokenController : JointImpedance {
  using JointImpedance::JointImpedance;
  double from = 0;
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau) noexcept override {
    JointImpedance::step(cycle, reference, tau);
    if (cycle.time > from) tau[3] = std::nan("");
  }
};
// Asks for steps of torque.
struct JumpingController : JointImpedance {
  using JointImpedance::JointImpedance;
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau) noexcept override {
    JointImpedance::step(cycle, reference, tau);
    tau.array() += std::fmod(cycle.time, 0.02) < 0.01 ? 4 : -4;
  }
};
struct ConstantTorque : JointImpedance {
  double torque;
  explicit ConstantTorque(double t) : JointImpedance(gains()), torque(t) {}
  void start(const Cycle&, Reference&) noexcept override {}
  void step(const Cycle&, const Reference&, Vector7& tau) noexcept override { tau.setConstant(torque); }
};
struct BrokenTrajectory : MinJerkJoint {
  using MinJerkJoint::MinJerkJoint;
  double from = 0;
  bool step(const Cycle& cycle, double time, Reference& reference) noexcept override {
    const bool over = MinJerkJoint::step(cycle, time, reference);
    if (time > from) reference.joint.q[2] = INFINITY;
    return over;
  }
};

struct ExertingTrajectory : MinJerkJoint {
  using MinJerkJoint::MinJerkJoint;
  Channels fills() const noexcept override { return Channels::kJoint | Channels::kTorque; }
  bool step(const Cycle& cycle, double time, Reference& reference) noexcept override {
    reference.torque.setConstant(2);
    return MinJerkJoint::step(cycle, time, reference);
  }
};
// Begins with its velocity.
struct LinearTrajectory : MinJerkJoint {
  using MinJerkJoint::MinJerkJoint;
  Vector7 from;
  void start(const Reference& reference) noexcept override {
    MinJerkJoint::start(reference);
    from = reference.joint.q;
  }
  bool step(const Cycle&, double time, Reference& reference) noexcept override {
    const Vector7 way = goal().joint.q - from;
    const double part = std::min(time / duration(), 1.);
    reference.joint = {from + part * way, way / duration() * (part < 1), Vector7::Zero()};
    return part == 1;
  }
};

// Looks whether the cycle is that of the arm.
struct SeesTheArm : MinJerkJoint {
  using MinJerkJoint::MinJerkJoint;
  int steps = 0, wrong = 0;
  bool step(const Cycle& cycle, double time, Reference& reference) noexcept override {
    ++steps;
    wrong += cycle.q != Vector7::Map(cycle.state.q.data()) || std::abs(cycle.time - time) > 1e-9;
    return MinJerkJoint::step(cycle, time, reference);
  }
};

// Does not keep to what a trajectory promises.
struct OddTrajectory : MinJerkJoint {
  enum What { kLeaps, kNeverEnds, kIsOverAtOnce } what;
  OddTrajectory(const Parameters& parameters, const models::Limits& limits, What w) : MinJerkJoint(parameters, limits), what(w) {}
  double duration() const noexcept override {
    return what == kNeverEnds ? INFINITY : what == kIsOverAtOnce ? 0 : MinJerkJoint::duration();
  }
  bool step(const Cycle& cycle, double time, Reference& reference) noexcept override {
    if (what == kIsOverAtOnce) reference = goal();
    const bool over = what == kIsOverAtOnce || MinJerkJoint::step(cycle, time, reference);
    if (what == kLeaps && !over && std::fmod(time, 0.2) > 0.1) reference.joint.q[1] += 0.5;
    return over && what != kNeverEnds;
  }
};

// Does not say which motion it makes, with a quaternion that is about one.
struct CarelessPose : MinJerkPose {
  double norm;
  CarelessPose(const Parameters& parameters, const models::Limits& limits, double n) : MinJerkPose(parameters, limits), norm(n) {}
  bool step(const Cycle& cycle, double time, Reference& reference) noexcept override {
    const bool over = MinJerkPose::step(cycle, time, reference);
    reference.motion = Channels::kJoint;
    reference.cartesian.orientation.coeffs() *= norm;
    return over;
  }
};

// From rest with almost all of the jerk that joint 1 has.
struct SteepTrajectory : MinJerkJoint {
  double jerk;
  SteepTrajectory(const Parameters& parameters, const models::Limits& limits)
      : MinJerkJoint(parameters, limits), jerk(0.9 * limits.dddq_max[0]) {}
  bool step(const Cycle& cycle, double time, Reference& reference) noexcept override {
    const bool over = MinJerkJoint::step(cycle, time, reference);
    constexpr double kSteep = 0.002;  // s
    if (time > kSteep) return over;
    reference.joint.q[0] += jerk * time * time * time / 6;
    reference.joint.dq[0] += jerk * time * time / 2;
    reference.joint.ddq[0] += jerk * time;
    return false;
  }
};

// Of each role, one that does something from a time on.
using Deed = void (*)();
void allocate() { ::operator delete(::operator new(8)); }
void take_5_ms() {
  const auto now = [] {
    timespec time;
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return time.tv_sec * 1'000'000'000ll + time.tv_nsec;
  };
  for (const auto end = now() + 5'000'000; now() < end;) {
  }
}
struct DoingController : JointImpedance {
  Deed deed;
  explicit DoingController(Deed d) : JointImpedance(gains()), deed(d) {}
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau) noexcept override {
    JointImpedance::step(cycle, reference, tau);
    if (cycle.time > 0.1) deed();
  }
};
struct DoingTrajectory : MinJerkJoint {
  Deed deed;
  DoingTrajectory(const Parameters& parameters, const models::Limits& limits, Deed d)
      : MinJerkJoint(parameters, limits), deed(d) {}
  bool step(const Cycle& cycle, double time, Reference& reference) noexcept override {
    if (time > 0.1) deed();
    return MinJerkJoint::step(cycle, time, reference);
  }
};
struct DoingTermination : Termination {
  Deed deed;
  explicit DoingTermination(Deed d) : deed(d) {}
  bool step(const Cycle& cycle, const Progress&) noexcept override {
    if (cycle.time > 0.1) deed();
    return false;
  }
};

struct AfterTime : Termination {
  double seconds;
  explicit AfterTime(double s) : seconds(s) {}
  bool step(const Cycle& cycle, const Progress&) noexcept override { return cycle.time >= seconds; }
};

// A loop, its robot, and the server room around it.
class LoopTest : public testing::Test {
 protected:
  explicit LoopTest(fci::Version version = 10, double hold_time = 2)
      : robot(models::arm("fr3"), version), model(models::urdf(models::arm("fr3"), version)) {
    options.hold_time = hold_time;
    remake();
  }

  void remake() { loop = std::make_unique<Loop>(robot, model, robot.limits, options, door); }

  ~LoopTest() override {
    if (allocations::kCounts) {
      EXPECT_EQ(allocations, 0u);
    }
    EXPECT_TRUE(robot.obeyed() || !judge) << robot.judgement();
    EXPECT_EQ(given, results_seen + unfinished());
    loop.reset();
    collect();
  }

  std::size_t unfinished() const { return in_work; }

  bool cycle() {
    bool goes_on;
    {
      const AllocationCounter counter;
      goes_on = loop->cycle();
      allocations += counter.count();
    }
    collect();
    return goes_on;
  }

  void collect() {
    while (const SkillResult* result = door.results.front()) {
      results.push_back(*result);
      ++results_seen;
      --in_work;
      door.results.pop();
    }
    while (Skill* const* skill = door.retired.front()) {
      delete *skill;
      ++retired;
      door.retired.pop();
    }
    while (Bounds* const* taken = door.taken_bounds.front()) {
      delete *taken;
      door.taken_bounds.pop();
    }
    while (Walls* const* former = door.former_walls.front()) {
      delete *former;
      door.former_walls.pop();
    }
    while (const RecoveryResult* result = door.recoveries.front()) {
      recoveries.push_back(*result);
      door.recoveries.pop();
    }
    while (records.next(last)) {
    }
  }

  bool cycles(int n) {
    while (n-- > 0) {
      if (!cycle()) return false;
    }
    return true;
  }

  // Cycles until it is so; false when it never was.
  bool until(const std::function<bool()>& so, int most = 10000) {
    while (most-- > 0) {
      if (so()) return true;
      if (!cycle()) return so();
    }
    return so();
  }
  bool until(Phase phase, int most = 10000) {
    return until([&] { return last.phase == phase; }, most);
  }
  bool until_result(int most = 20000) {
    const std::size_t before = results_seen;
    return until([&] { return results_seen > before; }, most);
  }

  std::uint64_t give(std::unique_ptr<TrajectoryGenerator> trajectory, std::unique_ptr<Controller> controller,
                     robot::Settings settings = {}, std::unique_ptr<Termination> termination = nullptr,
                     bool queued = false, double blend = 0, double speed = 1) {
    auto skill = std::make_unique<Skill>();
    if (queued) skill->after = given;
    skill->blend = blend;
    skill->speed = speed;
    skill->id = ++given;
    ++in_work;
    skill->mode = controller->mode(motion_of(trajectory->fills()));
    skill->settings = settings;
    skill->trajectory = std::move(trajectory);
    skill->controller = std::move(controller);
    skill->inputs = skill->trajectory->sensor_inputs();
    if (termination) skill->terminations.push_back(std::move(termination));
    door_put(std::move(skill));
    return given;
  }

  void door_put(std::unique_ptr<Skill> skill) {
    if (door.next.put(std::move(skill))) {  // as the server does
      ++results_seen;
      --in_work;
    }
  }

  std::unique_ptr<TrajectoryGenerator> steep() {
    return std::make_unique<SteepTrajectory>(MinJerkJoint::Parameters{robot.q(), 0.1}, robot.limits);
  }
  std::unique_ptr<TrajectoryGenerator> by(double delta, double duration) {
    return std::make_unique<RelativeMinJerkJoint>(
        RelativeMinJerkJoint::Parameters{Vector7::Constant(delta), duration}, robot.limits);
  }
  std::unique_ptr<TrajectoryGenerator> to_pose(const Vector3& by, double duration) {
    const Eigen::Isometry3d T = model.O_T_EE(robot.q());
    return std::make_unique<MinJerkPose>(
        MinJerkPose::Parameters{T.translation() + by, Eigen::Quaterniond(T.linear()), duration}, robot.limits);
  }
  std::uint64_t give_internal(double delta = 0.1, double duration = 0.5, robot::Settings settings = {}) {
    return give(by(delta, duration), std::make_unique<Internal>(), settings);
  }
  std::uint64_t give_torque(double delta = 0.1, double duration = 0.5, double scale = 1) {
    return give(by(delta, duration), std::make_unique<JointImpedance>(gains(scale)));
  }
  std::uint64_t give_after(double delta, double duration, double blend = 0) {
    return give(by(delta, duration), std::make_unique<Internal>(), {}, nullptr, true, blend);
  }
  std::uint64_t give_torque_after(double delta, double duration) {
    return give(by(delta, duration), std::make_unique<JointImpedance>(gains()), {}, nullptr, true);
  }
  int posted(fci::Command command) const { return robot.posted[static_cast<std::size_t>(command)]; }

  static robot::Settings stiffness(double K) {
    robot::Settings settings;
    settings.joint_impedance = fci::SetJointImpedance{};
    settings.joint_impedance->K_theta.fill(K);
    return settings;
  }

  MockRobot robot;
  Model model;
  Loop::Options options;
  Door door;
  bridge::RingReader<Record> records{door.records};
  std::unique_ptr<Loop> loop;
  Record last;
  std::deque<SkillResult> results;
  std::deque<RecoveryResult> recoveries;
  std::size_t given = 0, in_work = 0, results_seen = 0, retired = 0;
  std::uint64_t allocations = 0;
  bool judge = true;  // the robot's judgement counts at the end
};

TEST_F(LoopTest, JointMotionEndsAtItsGoalIsHeldAndThenFinished) {
  const Vector7 q = robot.q();
  give_internal(0.2, 0.6);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_EQ(results[0].skill_id, 1u);
  EXPECT_EQ(results[0].termination, -1);
  EXPECT_NEAR(results[0].time, 0.6, 0.01);
  EXPECT_NEAR((robot.q() - q - Vector7::Constant(0.2)).norm(), 0, 1e-6);
  EXPECT_EQ(last.phase, Phase::kHolding);
  EXPECT_EQ(retired, 0u) << "its controller holds the arm";

  const int commands = robot.commands;
  ASSERT_TRUE(until(Phase::kIdle));
  EXPECT_NEAR(robot.commands - commands, 2000, 5);
  EXPECT_FALSE(robot.in_motion());
  EXPECT_EQ(retired, 1u);
  EXPECT_EQ(robot.uncommanded, 0);
  EXPECT_NEAR((robot.q() - q - Vector7::Constant(0.2)).norm(), 0, 1e-6);
  EXPECT_EQ(posted(fci::Command::kMove), 1);
}

TEST_F(LoopTest, FirstCommandOfAMotionIsWhatTheRobotHolds) {
  give_internal(0.2, 0.3);
  ASSERT_TRUE(until([&] { return robot.commands == 1; }));
  for (int i = 0; i < 7; ++i) EXPECT_EQ(robot.command.q_c[i], last.state.q_d[i]);
  EXPECT_EQ(last.skill_time, 0);
}

TEST_F(LoopTest, TakesOverWithinAControllerWithoutAGapAtAnyMoment) {
  std::mt19937 random(1);
  give_internal(0.3, 0.6);
  ASSERT_TRUE(until(Phase::kRunning));
  for (int i = 0; i < 30; ++i) {
    cycles(std::uniform_int_distribution<>(1, 300)(random));
    give_internal(std::uniform_real_distribution<>(-0.15, 0.15)(random), 0.6);
    const int commands = robot.commands;
    cycle();
    EXPECT_EQ(last.skill_id, given) << "commanded in the cycle that finds it";
    EXPECT_EQ(robot.commands, commands + 1);
  }
  ASSERT_TRUE(until(Phase::kIdle));
  EXPECT_EQ(robot.uncommanded, 0);
  EXPECT_EQ(posted(fci::Command::kMove), 1);
}

TEST_F(LoopTest, TakesOverWhileHolding) {
  give_internal();
  ASSERT_TRUE(until(Phase::kHolding));
  cycles(100);
  give_internal();
  cycle();
  EXPECT_EQ(last.phase, Phase::kRunning);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(posted(fci::Command::kMove), 1);
  EXPECT_EQ(robot.uncommanded, 0);
}

TEST_F(LoopTest, SwitchesTheModeFromRestWithOneCycleWithoutACommand) {
  give_internal();
  ASSERT_TRUE(until(Phase::kHolding));
  give_torque();
  const int moves = posted(fci::Command::kMove);
  ASSERT_TRUE(until([&] { return last.skill_id == 2 && last.phase == Phase::kRunning; }, 10));
  EXPECT_EQ(robot.gap, 1);
  EXPECT_EQ(posted(fci::Command::kMove), moves + 1);
  ASSERT_TRUE(until_result());
  give_internal();
  ASSERT_TRUE(until([&] { return last.skill_id == 3 && last.phase == Phase::kRunning; }, 1500));
  EXPECT_EQ(robot.gap, 1);
  ASSERT_TRUE(until_result());
}

TEST_F(LoopTest, SwitchesTheModeAsSoonWhateverTheOrderOfTheAnswers) {
  struct Case {
    int started_delay, success_delay;
    bool success_first;
  };
  for (const Case& c : {Case{0, 0, false}, Case{20, 0, false}, Case{-1, 0, false}, Case{0, 20, false},
                        Case{0, 0, true}, Case{20, 20, false}, Case{20, 0, true}}) {
    robot.started_delay = c.started_delay;
    robot.success_delay = c.success_delay;
    robot.success_first = c.success_first;
    give_internal(0.02, 0.2);
    ASSERT_TRUE(until_result());
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    give_torque(0.02, 0.2);
    ASSERT_TRUE(until([&] { return last.skill_id == given && last.phase == Phase::kRunning; }, 10));
    EXPECT_EQ(robot.gap, 1);
    ASSERT_TRUE(until_result());
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
  }
}

TEST_F(LoopTest, BrakesAMovingSkillBeforeAnotherMode) {
  give_internal(0.5, 1);
  ASSERT_TRUE(until([&] { return last.skill_time > 0.5; }));
  give_torque();
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[0].ending, Ending::kPreempted);
  EXPECT_EQ(last.phase, Phase::kBraking);
  ASSERT_TRUE(until([&] { return last.skill_id == 2 && last.phase == Phase::kRunning; }, 1000));
  EXPECT_EQ(robot.gap, 1);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[1].ending, Ending::kTerminated);
}

TEST_F(LoopTest, AQueuedSkillBeginsWhenTheOneBeforeHasEnded) {
  for (const bool internal : {true, false}) {
    const Vector7 q = robot.q();
    internal ? give_internal(0.1, 0.3) : give_torque(0.1, 0.3);
    ASSERT_TRUE(until([&] { return last.phase == Phase::kRunning && last.skill_id == given; }));
    const int gaps = robot.uncommanded;
    internal ? give_after(0.05, 0.3) : give_torque_after(0.05, 0.3);
    ASSERT_TRUE(until_result());
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    EXPECT_EQ(last.phase, Phase::kHolding);
    cycle();
    EXPECT_EQ(last.skill_id, given);
    ASSERT_TRUE(until_result());
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    EXPECT_EQ(robot.uncommanded, gaps);
    cycles(internal ? 1 : 300);
    EXPECT_NEAR((robot.q() - q - Vector7::Constant(0.15)).norm(), 0, internal ? 1e-6 : 2e-3);
  }
}

TEST_F(LoopTest, AQueuedSkillOfAnotherModeCostsOneCycle) {
  give_internal(0.1, 0.3);
  cycles(100);
  give_torque_after(0.05, 0.3);
  ASSERT_TRUE(until_result());
  ASSERT_TRUE(until([&] { return last.skill_id == 2 && last.phase == Phase::kRunning; }, 10));
  EXPECT_EQ(robot.gap, 1);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results.back().ending, Ending::kTerminated);
}

TEST_F(LoopTest, BlendedMotionsDoNotStop) {
  give_internal(0.2, 0.6);
  cycles(100);
  give_after(0.2, 0.6, 0.25);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_NEAR(results[0].time, 0.35, 0.002);
  double slowest = 1;
  ASSERT_TRUE(until([&] {
    if (last.skill_time < 0.3) slowest = std::min(slowest, robot.dq().norm());
    return results_seen == 2;
  }));
  EXPECT_GT(slowest, 0.1);
  EXPECT_EQ(robot.uncommanded, 0);
}

TEST_F(LoopTest, WhatIsQueuedBehindAFailureIsCancelled) {
  give_internal(0.1, 0.5);
  cycles(100);
  give_after(0.1, 0.5);
  cycles(5);
  robot.reflex(fci::Error::kCartesianReflex);
  ASSERT_TRUE(until([&] { return results_seen == 2; }));
  EXPECT_EQ(results[0].ending, Ending::kRobotError);
  EXPECT_EQ(results[1].ending, Ending::kCancelled);
  door.recover = kNow;
  ASSERT_TRUE(until(Phase::kIdle));

  give_internal(0.1, 0.5);  // and one that comes too late
  cycles(100);
  door.stop_up_to = given;
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[2].ending, Ending::kStopped);
  give_after(0.1, 0.5);
  ASSERT_TRUE(until_result(3));
  EXPECT_EQ(results[3].ending, Ending::kCancelled);
}

TEST_F(LoopTest, SettingsInForceAreNotSentAgain) {
  options.settings.load = fci::SetLoad{0.5, {}, {}};
  options.settings.NE_T_EE = fci::SetNEToEE{};
  remake();
  cycles(5);
  EXPECT_EQ(posted(fci::Command::kSetLoad), 1) << "known to the robot before any motion";
  EXPECT_EQ(posted(fci::Command::kSetNEToEE), 1);

  give_internal(0.02, 0.1, stiffness(500));
  ASSERT_TRUE(until_result());
  give_internal(0.02, 0.1, stiffness(500));
  cycle();
  EXPECT_EQ(last.skill_id, 2u);
  ASSERT_TRUE(until_result());
  give_internal(0.02, 0.1);  // does not care
  cycle();
  EXPECT_EQ(last.skill_id, 3u);
  EXPECT_EQ(posted(fci::Command::kMove), 1);
  EXPECT_EQ(posted(fci::Command::kSetJointImpedance), 1);
  ASSERT_TRUE(until_result());

  give_internal(0.02, 0.1, stiffness(800));  // costs rest, a setter and a start
  ASSERT_TRUE(until_result());
  EXPECT_EQ(posted(fci::Command::kSetJointImpedance), 2);
  EXPECT_EQ(posted(fci::Command::kMove), 2);
  EXPECT_EQ(posted(fci::Command::kSetLoad), 1);
  EXPECT_EQ(posted(fci::Command::kSetNEToEE), 1);
  for (const SkillResult& result : results) EXPECT_EQ(result.ending, Ending::kTerminated);
}

TEST_F(LoopTest, UnevenTicksLeadAlongTheSameMotion) {
  struct Case {
    std::array<int, 8> ticks;
    int repeat;      // of even ticks after them
    double way;      // rad: greatest difference from the even motion
    double seconds;  // greatest delay of the end
  };
  for (const Case& c : {Case{{1, 1, 1, 1, 1, 1, 1, 1}, 0, 1e-6, 1e-3}, Case{{2, 1, 1, 1, 1, 1, 1, 1}, 10, 5e-5, 0.06},
                        Case{{1, 2, 1, 3, 5, 1, 1, 1}, 10, 3e-4, 0.2}, Case{{1, 2, 1, 3, 5, 1, 1, 2}, 0, 3e-3, 3}}) {
    const Vector7 q = robot.q();
    MinJerkJoint even({q + Vector7::Constant(0.3), 0.5}, robot.limits);
    Reference from, at;
    from.joint.q = q;
    even.start(from);
    give_internal(0.3, 0.5);
    double worst = 0;
    const std::size_t before = results.size();
    for (int i = 0; i < 5000 && results.size() == before; ++i) {
      robot.ticks = i / 8 % (c.repeat + 1) == 0 ? c.ticks : std::array<int, 8>{1, 1, 1, 1, 1, 1, 1, 1};
      ASSERT_TRUE(cycle());
      if (last.phase != Phase::kRunning) continue;
      even.step(at_home(), last.skill_time, at);
      worst = std::max(worst, (last.reference.joint.q - at.joint.q).norm());
    }
    ASSERT_GT(results.size(), before);
    EXPECT_LT(worst, c.way);
    EXPECT_NEAR(results.back().time, 0.5, 0.003 + c.seconds);
    EXPECT_NEAR((robot.q() - q - Vector7::Constant(0.3)).norm(), 0, 1e-6);
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    give_internal(-0.3, 0.5);
    robot.ticks.fill(1);
    ASSERT_TRUE(until_result());
    ASSERT_TRUE(until(Phase::kIdle));
  }
  EXPECT_GT(last.lost_states, 100u);
}

TEST_F(LoopTest, ATrajectorySeesTheCycleAsAControllerDoes) {
  const Vector7 goal = robot.q() + Vector7::Constant(0.2);
  auto trajectory = std::make_unique<SeesTheArm>(MinJerkJoint::Parameters{goal, 0.5}, robot.limits);
  const SeesTheArm& sees = *trajectory;
  give(std::move(trajectory), std::make_unique<JointImpedance>(gains()));
  ASSERT_TRUE(until(Phase::kHolding));  // the skill is kept until another takes over
  EXPECT_GE(sees.steps, 500);
  EXPECT_EQ(sees.wrong, 0);
}

TEST_F(LoopTest, SpeedIsThatOfTheTimeAlongTheTrajectory) {
  for (const double speed : {1., 0.5, 0.1}) {
    const Vector7 q = robot.q();
    MinJerkJoint even({q + Vector7::Constant(0.1), 0.5}, robot.limits);
    Reference from, at;
    from.joint.q = q;
    even.start(from);
    give(by(0.1, 0.5), std::make_unique<Internal>(), {}, nullptr, false, 0, speed);
    double worst = 0, worst_rate = 0;
    const std::size_t before = results.size();
    while (results.size() == before) {
      ASSERT_TRUE(cycle());
      if (last.phase != Phase::kRunning) continue;
      even.step(at_home(), speed * last.skill_time, at);
      worst = std::max(worst, (last.reference.joint.q - at.joint.q).norm());
      worst_rate = std::max(worst_rate, (last.reference.joint.dq - speed * at.joint.dq).norm());
    }
    EXPECT_LT(worst, 1e-6);
    EXPECT_LT(worst_rate, 1e-6);
    EXPECT_NEAR(results.back().time, 0.5 / speed, 3e-3);
    EXPECT_EQ(results.back().stretch, 1);
    ASSERT_TRUE(until(Phase::kIdle));
  }
}

TEST_F(LoopTest, AClockThatLeapsEndsNoSkillBadly) {
  for (const bool torque : {false, true}) {
    for (const std::uint64_t leap : {30ull, 3'000ull, 100'000'000ull, 1ull << 62}) {
      torque ? give_torque(0.2, 1) : give_internal(0.2, 1);
      ASSERT_TRUE(until([&] { return last.phase == Phase::kRunning && last.skill_time > 0.4; }));
      robot.leap = leap;
      ASSERT_TRUE(until_result()) << leap;
      EXPECT_TRUE(robot.obeyed()) << leap << ": " << robot.judgement();
      ASSERT_TRUE(until(Phase::kIdle));
      torque ? give_torque(-0.2, 1) : give_internal(-0.2, 1);
      ASSERT_TRUE(until_result());
      EXPECT_EQ(results.back().ending, Ending::kTerminated) << leap;
      ASSERT_TRUE(until(Phase::kIdle));
    }
  }
}

TEST_F(LoopTest, FollowsItsOwnReferenceThroughLostStatesUnderTorque) {
  robot.ticks = {1, 2, 1, 3, 5, 1, 1, 2};
  const Vector7 q = robot.q();
  give_torque(0.3, 0.5);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_NEAR(results[0].time, 0.5, 0.02);
  cycles(500);
  EXPECT_NEAR((robot.q() - q - Vector7::Constant(0.3)).norm(), 0, 1e-3);
  judge = false;  // the mock repeats the last torque for 5 ms: the robot's own rules, not checked here
}

TEST_F(LoopTest, TorqueKeepsItsRateFromTheLastCommandThatTheRobotTook) {
  for (const int lost : {0, 1, 2, 5, 15}) {
    give(by(0.1, 0.6), std::make_unique<JumpingController>(gains()));
    for (int i = 0; i < 20; ++i) {
      ASSERT_TRUE(cycles(23));
      robot.lose = lost;
    }
    EXPECT_LE(robot.worst_torque_rate, 1.001) << lost << " commands lost";
    ASSERT_TRUE(until(Phase::kIdle, 4000));
  }
  judge = false;  // states are rounded
}

TEST_F(LoopTest, GoesOnFromWhereTheRobotIsWhenCommandsWereLost) {
  const Vector7 q = robot.q();
  for (const int lost : {1, 2, 3, 7}) {
    for (const bool pose : {false, true}) {
      if (pose) {
        give(to_pose({0.02, -0.02, 0.02}, 0.2), std::make_unique<Internal>());
      } else {
        give_internal(0.15, 0.1);  // as fast as the limits allow
      }
      for (int i = 0; i < 8; ++i) {
        ASSERT_TRUE(cycles(19));
        robot.lose = lost;
      }
      ASSERT_TRUE(until_result());
      EXPECT_EQ(results.back().ending, Ending::kTerminated);
      EXPECT_TRUE(robot.obeyed()) << lost << " lost of " << (pose ? "poses" : "joints") << robot.judgement();
      give(std::make_unique<MinJerkJoint>(MinJerkJoint::Parameters{q, 0.5}, robot.limits), std::make_unique<Internal>());
      ASSERT_TRUE(until_result());
      EXPECT_NEAR((robot.q() - q).norm(), 0, 1e-6);
    }
  }
}

TEST_F(LoopTest, AMotionOfWhichTheFirstCommandsAreLostBeginsAnew) {
  for (const int lost : {0, 1, 2, 7}) {
    give(steep(), std::make_unique<Internal>());
    robot.lose = lost;
    ASSERT_TRUE(until_result());
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    EXPECT_TRUE(robot.obeyed()) << lost << " lost: " << robot.judgement();
    EXPECT_NEAR(results.back().time, 0.1, 0.01);
    ASSERT_TRUE(until(Phase::kIdle, 4000));
  }
}

TEST_F(LoopTest, WhatTakesOverFromAMotionOfWhichTheFirstCommandsAreLostBeginsItToo) {
  for (const int lost : {0, 1, 2, 7}) {
    for (const int after : {0, 1, 2, 3, 6, 7}) {
      SCOPED_TRACE(std::to_string(lost) + " lost, the next after " + std::to_string(after));
      give(steep(), std::make_unique<Internal>());
      robot.lose = lost;
      ASSERT_TRUE(until(Phase::kRunning));
      cycles(after);
      const std::size_t before = results.size();
      give(steep(), std::make_unique<Internal>());
      ASSERT_TRUE(until([&] { return results.size() == before + 2; }));
      EXPECT_EQ(results.back().ending, Ending::kTerminated);
      EXPECT_TRUE(robot.obeyed()) << robot.judgement();
      ASSERT_TRUE(until(Phase::kIdle, 4000));
    }
  }
}

TEST_F(LoopTest, AMotionOfWhichTheFirstCommandsAreLostIsLeftWhereItBegan) {
  for (const int lost : {1, 2, 7}) {
    for (const int after : {0, 1, 2}) {
      SCOPED_TRACE(std::to_string(lost) + " lost, left after " + std::to_string(after));
      const std::size_t before = results.size();
      give(steep(), std::make_unique<Internal>());
      robot.lose = lost;
      ASSERT_TRUE(until(Phase::kRunning));
      cycles(after);
      give_torque();  // of another mode
      ASSERT_TRUE(until([&] { return results.size() == before + 2; }));
      EXPECT_EQ(results.back().ending, Ending::kTerminated);
      EXPECT_TRUE(robot.obeyed()) << robot.judgement();
      ASSERT_TRUE(until(Phase::kIdle, 4000));
    }
  }
}

TEST_F(LoopTest, AChangeWaitsUntilTheFirstCommandHasCome) {
  for (const int lost : {0, 1, 2, 7}) {
    SCOPED_TRACE(lost);
    const std::uint64_t id = give(steep(), std::make_unique<Internal>());
    robot.lose = lost;
    ASSERT_TRUE(until(Phase::kRunning));
    auto change = std::make_unique<Change>();
    change->skill_id = id;
    change->trajectory = steep();
    door.change.put(std::move(change));
    ASSERT_TRUE(until_result());
    EXPECT_TRUE(robot.obeyed()) << robot.judgement();
    Change* const* changed = door.changed.front();
    ASSERT_TRUE(changed != nullptr);
    EXPECT_TRUE((*changed)->done);
    delete *changed;
    door.changed.pop();
    ASSERT_TRUE(until(Phase::kIdle, 4000));
  }
}

TEST_F(LoopTest, AMotionOfWhichTheFirstCommandsAreLostBeginsAnewWhereAnotherIsQueued) {
  for (const int lost : {1, 2, 7}) {
    give(steep(), std::make_unique<Internal>());
    ASSERT_TRUE(until(Phase::kStarting));
    give_after(0.1, 0.5);
    robot.lose = lost;
    const std::size_t before = results.size();
    ASSERT_TRUE(until([&] { return results.size() == before + 2; }));
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    EXPECT_TRUE(robot.obeyed()) << lost << " lost: " << robot.judgement();
    ASSERT_TRUE(until(Phase::kIdle, 4000));
  }
}

TEST_F(LoopTest, StopBrakesInsideTheLimitsThenHolds) {
  give_internal(0.8, 1);
  ASSERT_TRUE(until([&] { return last.skill_time > 0.4; }));
  const Vector7 q = robot.q();
  door.stop_up_to = 1;
  ASSERT_TRUE(until_result(500));
  EXPECT_EQ(results[0].ending, Ending::kStopped);
  EXPECT_EQ(last.phase, Phase::kHolding);
  EXPECT_GT((robot.q() - q).norm(), 1e-3);
  EXPECT_NEAR(robot.dq().norm(), 0, 1e-5);
  cycles(100);
  EXPECT_EQ(last.phase, Phase::kHolding);
  give_internal();  // a stop is for what was there when it came
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[1].ending, Ending::kTerminated);
}

TEST_F(LoopTest, StopReachesASkillThatHasNotBegun) {
  door.stop_up_to = 1;
  give_internal();
  ASSERT_TRUE(until_result(10));
  EXPECT_EQ(results[0].ending, Ending::kStopped);
  EXPECT_EQ(posted(fci::Command::kMove), 0);

  give_internal();  // waits for Move when the stop comes
  ASSERT_TRUE(until(Phase::kStarting));
  door.stop_up_to = 2;
  ASSERT_TRUE(until_result(10));
  EXPECT_EQ(results[1].ending, Ending::kStopped);

  give_internal(0.8, 1);
  ASSERT_TRUE(until([&] { return last.skill_time > 0.4; }));
  give_torque();  // waits for the arm to rest when the stop comes
  ASSERT_TRUE(until_result(5));
  door.stop_up_to = 4;
  ASSERT_TRUE(until_result(5));
  EXPECT_EQ(results[3].ending, Ending::kStopped);
  ASSERT_TRUE(until(Phase::kHolding, 1000));
  EXPECT_EQ(posted(fci::Command::kMove), 1);
}

TEST_F(LoopTest, TerminationInTheMiddleBrakesBeforeTheSkillEnds) {
  give(by(0.8, 1), std::make_unique<Internal>(), {}, std::make_unique<AfterTime>(0.4));
  ASSERT_TRUE(until(Phase::kBraking));
  EXPECT_TRUE(results.empty());
  ASSERT_TRUE(until_result(500));
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_EQ(results[0].termination, 0);
  EXPECT_NEAR(robot.dq().norm(), 0, 1e-5);
}

TEST_F(LoopTest, RobotErrorEndsTheSkillWithItsNameAndTheLoopGoesOn) {
  give_internal(0.5, 1);
  ASSERT_TRUE(until([&] { return last.skill_time > 0.3; }));
  robot.reflex(fci::Error::kJointReflex);
  ASSERT_TRUE(until_result(5));
  EXPECT_EQ(results[0].ending, Ending::kRobotError);
  EXPECT_EQ(fci::names(results[0].errors), "joint_reflex");
  EXPECT_EQ(results[0].robot_mode, fci::RobotMode::kReflex);
  EXPECT_EQ(last.phase, Phase::kError);
  EXPECT_EQ(retired, 1u);

  give_internal();
  ASSERT_TRUE(until_result(5));
  EXPECT_EQ(results[1].ending, Ending::kRobotError);
  EXPECT_EQ(fci::names(results[1].errors), "joint_reflex");

  door.recover = kNow;
  ASSERT_TRUE(until(Phase::kIdle, 20));
  ASSERT_EQ(recoveries.size(), 1u);
  EXPECT_TRUE(recoveries[0].recovered);
  give_internal();
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[2].ending, Ending::kTerminated);
}

TEST_F(LoopTest, ReflexWhileHoldingOrIdleIsSurvived) {
  give_internal();
  ASSERT_TRUE(until(Phase::kHolding));
  robot.reflex(fci::Error::kCartesianReflex);
  ASSERT_TRUE(until(Phase::kError, 5));
  EXPECT_EQ(results.size(), 1u);
  EXPECT_EQ(retired, 1u);
  door.recover = kNow;
  ASSERT_TRUE(until(Phase::kIdle, 20));
  robot.user_stop();
  ASSERT_TRUE(until(Phase::kError, 5));
  robot.release();
  cycles(20);
  EXPECT_EQ(last.phase, Phase::kError) << "somebody has to say that the arm may go on";
  door.recover = kNow;
  ASSERT_TRUE(until(Phase::kIdle, 5));
  EXPECT_EQ(posted(fci::Command::kAutomaticErrorRecovery), 1) << "of a user stop there is nothing to recover on the robot";
  give_torque();
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[1].ending, Ending::kTerminated);
}

TEST_F(LoopTest, UserStopWhileStartingEndsTheSkill) {
  robot.start_delay = 10;
  give_internal();
  ASSERT_TRUE(until(Phase::kStarting));
  robot.user_stop();
  ASSERT_TRUE(until_result(5));
  EXPECT_EQ(results[0].ending, Ending::kRobotError);
  EXPECT_EQ(results[0].robot_mode, fci::RobotMode::kUserStopped);
}

TEST_F(LoopTest, AUserStopBeforeAnySkillStopsNothing) {
  robot.user_stop();
  ASSERT_TRUE(until(Phase::kError, 5));
  robot.release();
  EXPECT_TRUE(until(Phase::kIdle, 5));
}

TEST_F(LoopTest, AUserStopThatIsStillPressedIsNotRecoveredFrom) {
  give_internal();
  ASSERT_TRUE(until(Phase::kRunning));
  robot.user_stop();
  ASSERT_TRUE(until(Phase::kError, 5));
  robot.refused = fci::Command::kAutomaticErrorRecovery;  // as robots do then
  door.recover = kNow;
  ASSERT_TRUE(until([&] { return !recoveries.empty(); }, 20));
  EXPECT_FALSE(recoveries[0].recovered);
  EXPECT_EQ(recoveries[0].robot_mode, fci::RobotMode::kUserStopped);
  robot.refused.reset();
  robot.release();
  cycles(5);
  EXPECT_EQ(last.phase, Phase::kError);
  door.recover = kNow;
  EXPECT_TRUE(until(Phase::kIdle, 5));
}

TEST_F(LoopTest, AResultSaysHowFarItCameAndWhatWasLost) {
  robot.ticks = {1, 1, 1, 1, 1, 1, 1, 3};
  give_internal(0.5, 1);
  ASSERT_TRUE(until([&] { return last.skill_time > 0.3; }));
  const std::uint64_t lost = last.lost_states;
  robot.lose = 5;
  cycles(10);
  robot.reflex(fci::Error::kCommunicationConstraints);
  ASSERT_TRUE(until_result(5));
  EXPECT_NEAR(results[0].path_time, results[0].time, 0.003);
  EXPECT_GE(results[0].path_time, 0.3);
  EXPECT_GE(results[0].lost_states, lost);
  EXPECT_LE(results[0].lost_states, lost + 6);
  EXPECT_EQ(results[0].lost_commands, 1u) << "in a hundred, as this robot says";
}

TEST_F(LoopTest, AUserStopIsNotTheReflexBeforeIt) {
  give_internal();
  ASSERT_TRUE(until(Phase::kRunning));
  robot.state.reflex_reason[static_cast<std::size_t>(fci::Error::kJointReflex)] = true;  // of the last one, which the robot keeps
  robot.user_stop();
  ASSERT_TRUE(until_result(5));
  EXPECT_EQ(results[0].ending, Ending::kRobotError);
  EXPECT_EQ(results[0].robot_mode, fci::RobotMode::kUserStopped);
  EXPECT_FALSE(fci::any(results[0].errors)) << fci::names(results[0].errors);
}

TEST_F(LoopTest, WhoHasNotSeenAnErrorHasNotAskedToRecoverFromIt) {
  give_internal();
  ASSERT_TRUE(until(Phase::kRunning));
  cycles(10);
  door.recover = last.cycles;
  robot.reflex(fci::Error::kJointReflex);
  ASSERT_TRUE(until([&] { return !recoveries.empty(); }, 5));
  ASSERT_TRUE(until(Phase::kError, 5));
  if (recoveries[0].recovered) {  // there was nothing, a cycle before
    door.recover = last.cycles - 1;
    ASSERT_TRUE(until([&] { return recoveries.size() == 2; }, 5));
  }
  EXPECT_FALSE(recoveries.back().recovered);
  EXPECT_TRUE(recoveries.back().unseen);
  EXPECT_EQ(posted(fci::Command::kAutomaticErrorRecovery), 0);
  door.recover = last.cycles;
  EXPECT_TRUE(until(Phase::kIdle, 20));
}

TEST_F(LoopTest, RefusedRecoveryIsReported) {
  robot.reflex(fci::Error::kJointReflex);
  ASSERT_TRUE(until(Phase::kError, 5));
  robot.refused = fci::Command::kAutomaticErrorRecovery;
  robot.refusal = fci::Status::kManualErrorRecoveryRequired;
  door.recover = kNow;
  ASSERT_TRUE(until([&] { return !recoveries.empty(); }, 50));
  EXPECT_FALSE(recoveries[0].recovered);
  EXPECT_EQ(recoveries[0].status, fci::Status::kManualErrorRecoveryRequired);
  EXPECT_EQ(last.phase, Phase::kError);

  robot.refused.reset();
  robot.silent = fci::Command::kAutomaticErrorRecovery;
  door.recover = kNow;
  ASSERT_TRUE(until([&] { return recoveries.size() == 2; }, 11000));
  EXPECT_FALSE(recoveries[1].recovered);
  EXPECT_EQ(recoveries[1].status, fci::Status::kFailed);
}

TEST_F(LoopTest, RecoveryWithNothingToRecoverFromSucceedsAtOnce) {
  cycles(3);
  door.recover = kNow;
  ASSERT_TRUE(until([&] { return !recoveries.empty(); }, 3));
  EXPECT_TRUE(recoveries[0].recovered);
  EXPECT_EQ(posted(fci::Command::kAutomaticErrorRecovery), 0);
}

TEST_F(LoopTest, RefusalsEndTheSkillWithRequestAndStatus) {
  robot.refused = fci::Command::kSetJointImpedance;
  robot.refusal = fci::Status::kInvalidArgument;
  give_internal(0.1, 0.2, stiffness(500));
  ASSERT_TRUE(until_result(50));
  EXPECT_EQ(results[0].ending, Ending::kRefused);
  EXPECT_EQ(results[0].refused, fci::Command::kSetJointImpedance);
  EXPECT_EQ(results[0].status, fci::Status::kInvalidArgument);
  EXPECT_EQ(posted(fci::Command::kMove), 0);

  robot.refused = fci::Command::kMove;
  robot.refusal = fci::Status::kStartAtSingularPose;
  give_internal();
  ASSERT_TRUE(until_result(50));
  EXPECT_EQ(results[1].ending, Ending::kRefused);
  EXPECT_EQ(results[1].refused, fci::Command::kMove);
  EXPECT_EQ(results[1].status, fci::Status::kStartAtSingularPose);

  robot.refused.reset();
  give_internal(0.1, 0.2, stiffness(500));
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[2].ending, Ending::kTerminated);
}

// The answer may precede the state.
TEST_F(LoopTest, AMotionThatAnErrorKeepsFromBeginningEndsWithThatError) {
  robot.refused = fci::Command::kMove;
  robot.refusal = fci::Status::kReflexAborted;
  robot.answer_delay = 2;
  give_internal();
  ASSERT_TRUE(until([&] { return posted(fci::Command::kMove) == 1; }));
  cycles(4);
  ASSERT_TRUE(results.empty());
  robot.reflex(fci::Error::kCartesianReflex);
  ASSERT_TRUE(until_result(5));
  EXPECT_EQ(results[0].ending, Ending::kRobotError);
  EXPECT_TRUE(results[0].errors[static_cast<std::size_t>(fci::Error::kCartesianReflex)]);
  EXPECT_EQ(posted(fci::Command::kMove), 1);
}

TEST_F(LoopTest, AnswersThatNeverComeEndTheSkillWithinASecond) {
  robot.silent = fci::Command::kSetJointImpedance;
  give_internal(0.1, 0.2, stiffness(500));
  ASSERT_TRUE(until_result(1010));
  EXPECT_EQ(results[0].ending, Ending::kRefused);
  EXPECT_EQ(results[0].refused, fci::Command::kSetJointImpedance);
  EXPECT_EQ(results[0].status, fci::Status::kFailed);

  robot.silent = fci::Command::kMove;
  give_internal();
  ASSERT_TRUE(until_result(1010));
  EXPECT_EQ(results[1].ending, Ending::kRefused);
  EXPECT_EQ(results[1].refused, fci::Command::kMove);
  EXPECT_EQ(posted(fci::Command::kStopMove), 1);

  robot.silent.reset();
  give_internal();
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[2].ending, Ending::kTerminated);
}

TEST_F(LoopTest, LostConnectionEndsSkillsAndLoop) {
  for (const auto how : {robot::Received::kLost, robot::Received::kNothing}) {
    robot.connection = robot::Received::kState;
    remake();
    give_internal(0.5, 1);
    ASSERT_TRUE(until([&] { return last.skill_time > 0.3; }));
    give_torque();
    cycles(2);
    robot.connection = how;
    const std::size_t before = results.size();
    EXPECT_FALSE(loop->run());
    collect();
    ASSERT_EQ(results.size(), before + 1);
    EXPECT_EQ(results.back().ending, Ending::kConnectionLost);
    robot.reflex(fci::Error::kCommunicationConstraints);
    robot.connection = robot::Received::kState;
    remake();
    ASSERT_TRUE(until(Phase::kError, 5));
    door.recover = kNow;
    ASSERT_TRUE(until(Phase::kIdle, 30));
  }
}

TEST_F(LoopTest, WhatIsNotFiniteNeverLeaves) {
  auto trajectory = std::make_unique<BrokenTrajectory>(
      MinJerkJoint::Parameters{robot.q() + Vector7::Constant(0.3), 0.6}, robot.limits);
  trajectory->from = 0.3;
  give(std::move(trajectory), std::make_unique<Internal>());
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[0].ending, Ending::kComponentFault);
  EXPECT_EQ(last.phase, Phase::kHolding);
  EXPECT_TRUE(robot.q().allFinite());

  auto controller = std::make_unique<BrokenController>(gains());
  controller->from = 0.3;
  give(by(0.3, 0.6), std::move(controller));
  ASSERT_TRUE(until([&] { return last.skill_id == 2 && last.phase == Phase::kRunning; }));
  ASSERT_TRUE(until([&] {
    for (double tau : robot.command.tau_J_d) EXPECT_TRUE(std::isfinite(tau));
    return results.size() == 2;
  }));
  EXPECT_EQ(results[1].ending, Ending::kComponentFault);
  ASSERT_TRUE(until(Phase::kIdle, 3000)) << "nothing is left that could hold the arm: the robot does";

  give_internal();
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[2].ending, Ending::kTerminated);
}

TEST_F(LoopTest, TrajectoriesThatDoNotKeepTheirWordEndWithTheArmAtRest) {
  for (const auto what : {OddTrajectory::kLeaps, OddTrajectory::kNeverEnds, OddTrajectory::kIsOverAtOnce}) {
    for (const bool torque : {false, true}) {
      SCOPED_TRACE(testing::Message() << what << (torque ? " torque" : " motion"));
      auto trajectory = std::make_unique<OddTrajectory>(
          MinJerkJoint::Parameters{robot.q() + Vector7::Constant(0.2), 0.6}, robot.limits, what);
      std::unique_ptr<Controller> controller = std::make_unique<Internal>();
      if (torque) controller = std::make_unique<JointImpedance>(gains());
      const Vector7 goal = robot.q() + Vector7::Constant(0.2);
      const std::uint64_t id = give(std::move(trajectory), std::move(controller));
      if (what == OddTrajectory::kNeverEnds) {
        cycles(1500);
        door.stop_up_to = id;
      }
      ASSERT_TRUE(until_result());
      EXPECT_EQ(results.back().ending, what == OddTrajectory::kNeverEnds ? Ending::kStopped : Ending::kTerminated);
      EXPECT_EQ(last.phase, Phase::kHolding);
      cycles(500);
      EXPECT_LT((robot.q() - goal).cwiseAbs().maxCoeff(), 3e-3);
      give_internal(-0.2, 0.6);
      ASSERT_TRUE(until_result());
      EXPECT_EQ(results.back().ending, Ending::kTerminated);
      ASSERT_TRUE(until(Phase::kIdle));
    }
  }
}

TEST_F(LoopTest, AControllerThatAsksForAMillionNewtonMetresIsBoundedAndTheArmComesToRest) {
  for (const double torque : {1e6, -1e6}) {
    give(by(0, 0.6), std::make_unique<ConstantTorque>(torque), {}, std::make_unique<AfterTime>(0.5));
    ASSERT_TRUE(until_result());
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    ASSERT_TRUE(until(Phase::kIdle));
    for (int i = 0; i < 7; ++i) {
      EXPECT_GT(robot.q()[i], robot.limits.q_min[i]);
      EXPECT_LT(robot.q()[i], robot.limits.q_max[i]);
    }
    give_internal(torque > 0 ? -0.05 : 0.05, 0.6);
    ASSERT_TRUE(until_result());
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    ASSERT_TRUE(until(Phase::kIdle));
  }
}

// The loop of a server that counts, and where the loop is.
class WatchedLoop : public LoopTest {
 protected:
  WatchedLoop() {
    options.watch = {allocations::of_this_thread, &in_part};
    remake();
    judge = false;  // a step of 5 ms costs no states here, but the mock's clock knows nothing of it
  }
  // Of the parts 1, 2, 3 and, within another, 4 the one with this number does that.
  SkillResult run(std::uint16_t guilty, Deed deed) {
    const auto nothing = [] {};
    auto skill = std::make_unique<Skill>();
    skill->id = ++given;
    ++in_work;
    skill->mode = robot::kTorque;
    skill->trajectory = std::make_unique<DoingTrajectory>(
        MinJerkJoint::Parameters{robot.q() + Vector7::Constant(0.05), 0.5}, robot.limits, guilty == 1 ? deed : nothing);
    skill->controller = std::make_unique<DoingController>(guilty == 2 ? deed : nothing);
    skill->terminations.push_back(std::make_unique<AfterTime>(0.4));
    skill->terminations.push_back(std::make_unique<DoingTermination>(guilty == 3 ? deed : nothing));
    Terminations within;
    within.push_back(std::make_unique<DoingTermination>(guilty == 4 ? deed : nothing));
    skill->terminations.push_back(std::make_unique<AnyOf>(std::move(within), std::vector<std::uint16_t>{4}));
    skill->numbers = {1, 2, {9, 3, 8}};
    door_put(std::move(skill));
    EXPECT_TRUE(until_result());
    return results.back();
  }
  std::atomic<std::uint32_t> in_part{0};
};

TEST_F(WatchedLoop, APartThatAllocatesIsNamedAndTheArmGoesOn) {
  if (!allocations::kCounts) GTEST_SKIP() << "the heap belongs to a sanitizer";
  for (const std::uint16_t guilty : {1, 2, 3, 4}) {
    const SkillResult result = run(guilty, allocate);
    EXPECT_EQ(result.ending, Ending::kComponentFault);
    EXPECT_EQ(result.fault.why, PartFault::Why::kAllocates);
    EXPECT_EQ(result.fault.part, guilty);
    EXPECT_NEAR(result.time, 0.1, 0.1);
    const SkillResult next = run(0, nullptr);
    EXPECT_EQ(next.ending, Ending::kTerminated);
    EXPECT_EQ(next.termination, 0);
  }
  allocations = 0;  // those were wanted
}

TEST_F(WatchedLoop, APartThatTakesTooLongIsNamed) {
  for (const std::uint16_t guilty : {1, 2, 3, 4}) {
    const SkillResult result = run(guilty, take_5_ms);
    EXPECT_EQ(result.ending, Ending::kComponentFault);
    EXPECT_EQ(result.fault.why, PartFault::Why::kTooLong);
    EXPECT_EQ(result.fault.part, guilty);
    EXPECT_GE(result.fault.ns, 5'000'000);
  }
}

TEST_F(WatchedLoop, OneLongStepIsNoFault) {
  static bool done;
  done = false;
  const SkillResult result = run(2, [] {
    if (!std::exchange(done, true)) take_5_ms();
  });
  EXPECT_EQ(result.ending, Ending::kTerminated);
}

TEST_F(WatchedLoop, WhatIsNotFiniteIsNamed) {
  auto skill = std::make_unique<Skill>();
  skill->id = ++given;
  ++in_work;
  skill->mode = robot::kTorque;
  skill->trajectory = by(0.05, 0.5);
  auto controller = std::make_unique<BrokenController>(gains());
  controller->from = 0.1;
  skill->controller = std::move(controller);
  skill->numbers = {1, 2, {}};
  door_put(std::move(skill));
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results.back().fault.why, PartFault::Why::kNotFinite);
  EXPECT_EQ(results.back().fault.part, 2);
}

TEST_F(WatchedLoop, SaysWhichPartItIsInAndThatItIsInNone) {
  static std::atomic<std::uint32_t>* where;
  static std::array<int, 10> seen;
  where = &in_part;
  seen = {};
  const auto look = [] { ++seen.at(where->load()); };
  for (const std::uint16_t number : {1, 2, 3, 4}) {
    seen = {};
    run(number, look);
    EXPECT_GT(seen[number], 0);
    EXPECT_EQ(std::accumulate(seen.begin(), seen.end(), 0), seen[number]);
    EXPECT_EQ(in_part, 0u);
  }
}

TEST_F(LoopTest, TorqueBesideAMotionIsContinuousAndSurvivesAFault) {
  const robot::Mode mode = {fci::ControllerMode::kExternal, Generator::kJointPosition};
  const auto give_beside = [&](std::unique_ptr<Controller> controller) {
    auto skill = std::make_unique<Skill>();
    skill->id = ++given;
    ++in_work;
    skill->mode = mode;
    skill->trajectory = by(0.05, 0.5);
    skill->controller = std::move(controller);
    door_put(std::move(skill));
  };
  const auto tau = [&] { return Vector7(Vector7::Map(robot.command.tau_J_d.data())); };
  give_beside(std::make_unique<ConstantTorque>(0));
  ASSERT_TRUE(until([&] { return last.skill_time > 0.1; }));
  for (const double torque : {4.0, -3.0, 1.0}) {
    const Vector7 before = tau();
    give_beside(std::make_unique<ConstantTorque>(torque));
    cycle();
    EXPECT_EQ(last.skill_id, given);
    EXPECT_LT((tau() - before).cwiseAbs().maxCoeff(), 0.05);
    cycles(150);
    EXPECT_NEAR((tau() - Vector7::Constant(torque)).norm(), 0, 1e-9);
  }
  auto broken = std::make_unique<BrokenController>(gains());
  broken->from = -1;  // from its first cycle on
  give_beside(std::move(broken));
  ASSERT_TRUE(until([&] { return !results.empty() && results.back().ending == Ending::kComponentFault; }, 3000));
  ASSERT_TRUE(until(Phase::kIdle, 3000));
  give_torque(0.05, 0.5);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results.back().ending, Ending::kTerminated);
}

TEST_F(LoopTest, TorqueIsContinuousWhenTheControllerChanges) {
  give_torque(0.3, 1);
  ASSERT_TRUE(until([&] { return last.skill_time > 0.5; }));
  Vector7 tau = Vector7::Map(robot.command.tau_J_d.data());
  give_torque(0.1, 1, 0.5);
  cycle();
  EXPECT_EQ(last.skill_id, 2u);
  EXPECT_LT((Vector7::Map(robot.command.tau_J_d.data()) - tau).cwiseAbs().maxCoeff(), 0.5);
  ASSERT_TRUE(until([&] { return results_seen == 2; }));
  EXPECT_EQ(posted(fci::Command::kMove), 1);
  EXPECT_EQ(robot.uncommanded, 0);
}

TEST_F(LoopTest, WhatATrajectoryHasExertedFadesBesideTheNext) {
  give(std::make_unique<ExertingTrajectory>(MinJerkJoint::Parameters{robot.q(), 5}, robot.limits),
       std::make_unique<JointImpedance>(gains()));
  ASSERT_TRUE(until([&] { return last.skill_time > 0.5; }));
  EXPECT_EQ(last.reference.torque[0], 2);
  give_torque(0.05, 0.5);
  double torque = 2;
  ASSERT_TRUE(cycle());
  ASSERT_EQ(last.skill_id, 2u);
  for (; last.skill_time < 0.4; cycle()) {
    EXPECT_LE(std::abs(last.reference.torque[0] - torque), 0.05);
    torque = last.reference.torque[0];
  }
  EXPECT_LT(torque, 0.01);
}

TEST_F(LoopTest, ReferencesOfBothKindsShareATorqueMotion) {
  give_torque(0.1, 0.5);
  ASSERT_TRUE(until([&] { return last.skill_time > 0.25; }));
  give(to_pose({0.02, 0.02, -0.02}, 0.6), std::make_unique<PoseSpring>());
  cycle();
  EXPECT_EQ(last.skill_id, 2u);
  EXPECT_EQ(last.reference.motion, Channels::kPose);
  EXPECT_LT((last.reference.cartesian.position - model.O_T_EE().translation()).norm(), 0.02);
  cycles(300);
  give_torque(0.05, 0.5);
  cycle();
  EXPECT_EQ(last.skill_id, 3u);
  EXPECT_EQ(last.reference.motion, Channels::kJoint);
  ASSERT_TRUE(until([&] { return results_seen == 3; }));
  EXPECT_EQ(posted(fci::Command::kMove), 1);
  EXPECT_EQ(robot.uncommanded, 0);
}

TEST_F(LoopTest, PoseMotionEndsAtItsGoal) {
  const Vector3 goal = model.O_T_EE(robot.q()).translation() + Vector3(0.05, -0.03, 0.02);
  give(to_pose({0.05, -0.03, 0.02}, 0.6), std::make_unique<Internal>());
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_NEAR((last.reference.cartesian.position - goal).norm(), 0, 1e-6);
  EXPECT_EQ(robot.moved, kInternalPose);
}

TEST_F(LoopTest, QuitBrakesFinishesAndReturns) {
  give_internal(0.8, 1);
  ASSERT_TRUE(until([&] { return last.skill_time > 0.4; }));
  door.quit = true;
  EXPECT_TRUE(loop->run());
  collect();
  EXPECT_EQ(results[0].ending, Ending::kStopped);
  EXPECT_FALSE(robot.in_motion());
  EXPECT_EQ(robot.uncommanded, 0);
}

TEST_F(LoopTest, QuitReturnsFromIdleAndFromErrors) {
  cycles(5);
  door.quit = true;
  EXPECT_TRUE(loop->run());
  door.quit = false;
  remake();
  robot.reflex(fci::Error::kJointReflex);
  ASSERT_TRUE(until(Phase::kError, 5));
  door.quit = true;
  EXPECT_TRUE(loop->run());
}

TEST_F(LoopTest, KeepsTheLimitsUnderRandomPreemptions) {
  const unsigned seed = 7;
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<> unit(-1, 1);
  for (int i = 0; i < 150; ++i) {
    Vector7 q = Vector7::Map(models::kHome.data());
    for (int k = 0; k < 7; ++k) q[k] += 0.4 * unit(random);
    auto trajectory = std::make_unique<MinJerkJoint>(MinJerkJoint::Parameters{q, 0.05 + 0.4 * std::abs(unit(random))},
                                                     robot.limits);
    const int kind = std::uniform_int_distribution<>(0, 9)(random);
    if (kind < 8) {
      give(std::move(trajectory), std::make_unique<Internal>(), kind == 7 ? stiffness(100 + i) : robot::Settings{});
    } else {
      give(std::move(trajectory), std::make_unique<JointImpedance>(gains()));
    }
    if (kind == 3) robot.ticks = {1, 1, 1, 2, 1, 1, 1, 3};
    if (kind == 4) robot.ticks.fill(1);
    cycles(std::uniform_int_distribution<>(0, 250)(random));
    if (kind == 5) door.stop_up_to = given;
  }
  ASSERT_TRUE(until(Phase::kHolding));
  EXPECT_EQ(results_seen, given);
}

TEST_F(LoopTest, TakesNoSkillWhoseResultWouldFindNoRoom) {
  give_internal(0.1, 5);
  const AllocationCounter counter;
  for (int i = 0; i < 200; ++i) {  // nobody collects
    auto skill = std::make_unique<Skill>();
    skill->id = ++given;
    ++in_work;
    skill->trajectory = by(0.001, 5);
    skill->controller = std::make_unique<Internal>();
    skill->mode = kInternalJoint;
    if (door.next.put(std::move(skill))) {
      ++results_seen;
      --in_work;
    }
    loop->cycle();
    loop->cycle();
  }
  EXPECT_LE(door.results.room(), 4u);
  collect();
  ASSERT_TRUE(until([&] { return in_work == 0; }, 10000));
}

TEST_F(LoopTest, AMotionThatIsNotYetPossibleIsAskedForAgain) {
  robot.refused = fci::Command::kMove;
  robot.refusal = fci::Status::kNotPossible;
  give_internal();
  ASSERT_TRUE(until([&] { return posted(fci::Command::kMove) == 3; }, 200));
  EXPECT_EQ(results_seen, 0u);
  robot.refused.reset();
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[0].ending, Ending::kTerminated);

  ASSERT_TRUE(until(Phase::kIdle));
  robot.refused = fci::Command::kMove;
  give_internal();
  ASSERT_TRUE(until_result(1500)) << "and within a second the skill is over";
  EXPECT_EQ(results[1].ending, Ending::kRefused);
  EXPECT_EQ(results[1].status, fci::Status::kNotPossible);
}

TEST_F(LoopTest, APoseThatIsLeftFromAFormerMotionIsNotBelieved) {
  Eigen::Isometry3d T = model.O_T_EE(robot.q());
  T.rotate(Eigen::AngleAxisd(0.05, Vector3::UnitY()));
  robot.stale_pose = T.matrix();
  give(to_pose({0, 0, 0.05}, 0.5), std::make_unique<Internal>());
  ASSERT_TRUE(until_result());  // and the robot judges what it was sent
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
}

TEST_F(LoopTest, ARobotWhoseKinematicsAreNotOursIsBelievedWhereItIs) {
  const Vector7 q = robot.q(), q_d = q + Vector7::Constant(1e-3);
  Eigen::Isometry3d calibrated = Eigen::Isometry3d::Identity();
  calibrated.translation() << 0.02, 0, 0.1;
  const Eigen::Isometry3d there = model.O_T_EE(q_d) * calibrated;
  fci::RobotState state{};
  Vector7::Map(state.q_d.data()) = q_d;
  Eigen::Matrix4d::Map(state.O_T_EE_c.data()) = there.matrix();
  Cycle cycle{state, model};
  cycle.q = q;
  cycle.O_T_EE = model.O_T_EE(q) * calibrated;
  const Reference start = robot_controller(kInternalPose).start(cycle, Channels::kPose, model);
  EXPECT_LT((start.cartesian.position - there.translation()).norm(), 1e-12);
}

// From states whose reals were rounded: the pose that the robot begins from is the one of its joints, also next to a singular posture.
TEST_F(LoopTest, APoseThatWasRoundedDoesNotMoveTheJoints) {
  const auto rounded = [](const auto& x) { return x.template cast<float>().template cast<double>().eval(); };
  Vector7 q{0.4293, 0.2879, -0.1371, -2.1408, -1.1398, 3.365, 2.1671};
  for (int n = 0; n < 50; ++n) {
    q.array() += 1e-3;
    const Eigen::Isometry3d there = model.O_T_EE(q);
    fci::RobotState state{};
    Vector7::Map(state.q_d.data()) = rounded(q);
    Eigen::Matrix4d::Map(state.O_T_EE_c.data()) = rounded(there.matrix());
    Cycle cycle{state, model};
    cycle.q = rounded(q);
    cycle.O_T_EE = there;
    const Reference start = robot_controller(kInternalPose).start(cycle, Channels::kPose, model);
    const Vector7 way = model.joints_of_pose(q, Model::kNoDamping).dq_dP * change_between(at(there), start.cartesian);
    EXPECT_LT(way.cwiseAbs().maxCoeff(), 5e-7) << n;
  }
}

TEST_F(LoopTest, AMotionIsNotFinishedWhileTheArmStillMoves) {
  // Torques that keep the arm swinging, with a reference at rest.
  struct Swinging : JointImpedance {
    using JointImpedance::JointImpedance;
    bool tracks() const noexcept override { return true; }
    void step(const Cycle& cycle, const Reference& reference, Vector7& tau) noexcept override {
      JointImpedance::step(cycle, reference, tau);
      tau[0] += 8 * std::sin(20 * cycle.time);
    }
  };
  give(by(0.05, 0.3), std::make_unique<Swinging>(gains(0.2)));
  ASSERT_TRUE(until_result());
  give_internal();  // another mode: the motion has to be finished
  ASSERT_TRUE(until([&] { return results_seen == 2; }, 10000));
  EXPECT_EQ(results[1].ending, Ending::kTerminated);
  EXPECT_FALSE(robot.finished_while_moving);
}

TEST_F(LoopTest, AnArmThatIsHeldIsWaitedForAndDoesNotLeap) {
  for (const bool pose : {false, true}) {
    SCOPED_TRACE(pose);
    const Vector7 q = robot.q();
    if (pose) {
      give(to_pose({0.1, 0.3, -0.1}, 4), std::make_unique<CartesianImpedance>(CartesianImpedance::Parameters{
                                              Vector3::Constant(600), Vector3::Constant(50), 1, 10}));
    } else {
      give(by(0.8, 2), std::make_unique<JointImpedance>(gains()));
    }
    ASSERT_TRUE(until(Phase::kRunning));
    cycles(100);
    robot.locked = true;
    cycles(3000);
    EXPECT_EQ(last.phase, Phase::kRunning) << "the path waits";
    robot.locked = false;
    robot.fastest = 0;
    cycles(200);
    EXPECT_LT(robot.fastest, 0.3);
    ASSERT_TRUE(until_result());
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    cycles(1500);
    if (!pose) {
      EXPECT_NEAR((robot.q() - q - Vector7::Constant(0.8)).norm(), 0, 0.01);
    }
    give_internal(-0.8, 3);
    ASSERT_TRUE(until_result());
  }
  judge = false;  // the mock's torque rate in float32
}

TEST_F(LoopTest, AnArmThatIsHeldIsNotWaitedForWhereItHasNoSpring) {
  auto soft = gains();
  soft.stiffness[6] = 0;
  const Vector7 goal = robot.q() + 0.6 * Vector7::Unit(6);
  robot.locked = true;
  give(std::make_unique<MinJerkJoint>(MinJerkJoint::Parameters{goal, 2}, robot.limits), std::make_unique<JointImpedance>(soft));
  ASSERT_TRUE(until_result(4000));
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_FALSE(has(results[0].held_by, HeldBy::kArm));
  judge = false;  // the mock's torque rate in float32
}

// What a stream wants, or sums up, while something is in its way does not have to be undone first.
TEST_F(LoopTest, AVelocityStreamEndsWhenItIsLetGoWhateverHasHeldItBack) {
  Bounds slow(robot.limits);
  slow.tool_speed = slow.limits.translation.velocity = 0.1;
  door.bounds.put(std::make_unique<Bounds>(slow));
  for (const bool pose : {false, true}) {
    SCOPED_TRACE(pose);
    const StreamJointVelocity::Parameters parameters{"pace", 0.2, 1};
    std::unique_ptr<TrajectoryGenerator> stream;
    if (pose) {
      stream = std::make_unique<StreamCartesianVelocity>(parameters, robot.limits);
    } else {
      stream = std::make_unique<StreamJointVelocity>(parameters, robot.limits);
    }
    const auto input = stream->sensor_inputs().at(0);
    std::unique_ptr<Controller> law = std::make_unique<Internal>();
    if (pose) law = std::make_unique<CartesianImpedance>(CartesianImpedance::Parameters{Vector3::Constant(600), Vector3::Constant(50), 1, 10});
    give(std::move(stream), std::move(law), {}, std::make_unique<AfterTime>(pose ? 3 : 6));
    ASSERT_TRUE(until(Phase::kRunning));
    const auto where = [&]() -> Vector3 {
      return pose ? last.reference.cartesian.position : Vector3(model.O_T_EE(last.reference.joint.q).translation());
    };
    const auto wish = [&](double velocity, int ms) {
      SensorSample sample;
      sample.values[pose ? 3 : 2] = velocity;  // along y, or of joint 1
      for (int i = 0; i < ms; ++i) {
        sample.came = robot.state.message_id;
        if (i % 10 == 0) input->put(sample);
        cycle();
      }
    };
    const Vector3 began = where();
    wish(0.5, pose ? 1000 : 2000);
    const Vector3 there = where();
    EXPECT_NEAR((there - began).norm(), pose ? 0.095 : 0.19, 0.02) << "as fast as it may";
    cycles(500);  // of which it is silent
    const Vector3 rested = where();
    EXPECT_LT((rested - there).norm(), 0.04);
    cycles(100);
    EXPECT_LT((where() - rested).norm(), 1e-5);
    wish(0.5, 300);
    const Vector3 turned = where();
    wish(-0.5, pose ? 600 : 300);  // poses catch up gently
    EXPECT_LT((where() - turned).dot((there - began).normalized()), -0.005) << "and comes back at once";
    ASSERT_TRUE(until_result());
  }
}

TEST_F(LoopTest, AStreamComesBackFromWhereItsArmWasHeld) {
  auto stream = std::make_unique<StreamJoint>(StreamJoint::Parameters{.topic = "goal", .delay = {}, .timeout = {}, .speed = 1}, robot.limits);
  const auto input = stream->sensor_inputs().at(0);
  give(std::move(stream), std::make_unique<JointImpedance>(gains()), {}, std::make_unique<AfterTime>(7));
  ASSERT_TRUE(until(Phase::kRunning));
  const Vector7 home = robot.q();
  robot.locked = true;
  double farthest = 0;
  const auto targets = [&](double way, int ms) {
    SensorSample sample;
    Vector7::Map(sample.values.data() + 2) = home + way * Vector7::Unit(0);
    for (int i = 0; i < ms; ++i) {
      sample.came = robot.state.message_id;
      if (i % 20 == 0) input->put(sample);
      cycle();
      farthest = std::max(farthest, last.reference.joint.q[0] - home[0]);
    }
  };
  targets(1, 3000);
  EXPECT_TRUE(has(last.held_by, HeldBy::kArm));
  EXPECT_GT(farthest, 0.2);
  EXPECT_LT(farthest, 0.4) << "it goes no farther from an arm that does not follow";
  targets(0, 1500);
  EXPECT_NEAR(last.reference.joint.q[0], home[0], 1e-3);
  robot.locked = false;
  ASSERT_TRUE(until_result());
  judge = false;  // the mock's torque rate in float32
}

TEST_F(LoopTest, WhatCameBeforeAFirstCommandThatIsLostIsNotLostWithIt) {
  for (const int lost : {0, 1, 2}) {
    SCOPED_TRACE(lost);
    auto stream =
        std::make_unique<StreamJoint>(StreamJoint::Parameters{.topic = "plan", .delay = {}, .timeout = {}, .speed = 1}, robot.limits);
    const Vector7 goal = robot.q() + 0.05 * Vector7::Unit(3);
    SensorSample sample;
    sample.message = 2;  // JointChunk
    sample.lead = 0.4;
    sample.came = robot.state.message_id;
    Vector7::Map(sample.values.data()) = goal;
    stream->sensor_inputs().at(0)->put(sample);
    robot.lose = lost;
    give(std::move(stream), std::make_unique<Internal>(), {}, std::make_unique<AfterTime>(2));
    ASSERT_TRUE(until_result());
    EXPECT_NEAR((robot.q() - goal).norm(), 0, 1e-4);
    ASSERT_TRUE(until(Phase::kIdle));
  }
}

TEST_F(LoopTest, AMotionIsHeldOnForWhatBeginsSoon) {
  const auto cycle_of_clock = [&] {
    robot.received += 1'000'000;
    return cycle();
  };
  give_internal();
  while (last.phase != Phase::kHolding) ASSERT_TRUE(cycle_of_clock());
  for (int n = 0; n < 1990; ++n) cycle_of_clock();
  auto skill = std::make_unique<Skill>();
  skill->id = ++given;
  ++in_work;
  skill->mode = kInternalJoint;
  skill->trajectory = by(0.1, 0.3);
  skill->controller = std::make_unique<Internal>();
  skill->start_ns = robot.received + 20'000'000;
  door_put(std::move(skill));
  for (int n = 0; n < 25; ++n) cycle_of_clock();
  EXPECT_EQ(last.phase, Phase::kRunning);
  EXPECT_EQ(last.skill_id, 2u);
  while (results_seen < 2) ASSERT_TRUE(cycle_of_clock());
  EXPECT_EQ(posted(fci::Command::kMove), 1);
  EXPECT_EQ(robot.uncommanded, 0);
}

TEST_F(LoopTest, APoseOfOnesOwnIsAboutOne) {
  const Eigen::Isometry3d T = model.O_T_EE(robot.q());
  const MinJerkPose::Parameters to{T.translation() + Vector3(0, 0.1, 0), Eigen::Quaterniond(T.linear()), 1};
  give(std::make_unique<CarelessPose>(to, robot.limits, 1.01), std::make_unique<Internal>());
  ASSERT_TRUE(until_result(3000));
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_NEAR((last.reference.cartesian.position - to.position).norm(), 0, 1e-4);
  give(std::make_unique<CarelessPose>(to, robot.limits, 2), std::make_unique<Internal>());
  ASSERT_TRUE(until_result(3000));
  EXPECT_EQ(results[1].ending, Ending::kComponentFault);
}

TEST_F(LoopTest, WhoSeeksAGoalThatAWallIsInTheWayOfEndsBeforeIt) {
  const auto wall_at = [&](double y) {
    auto walls = std::make_unique<Walls>(Walls{ArmCapsules(models::arm("fr3"), true), {}});
    walls->walls.push_back({1, testing_tools::plane({0, y, 0}, -Vector3::UnitY())});
    return walls;
  };
  door.walls.put(wall_at(0.25));
  const Vector7 goal = robot.q() + Vector7::Unit(0);
  give(std::make_unique<MinJerkJoint>(MinJerkJoint::Parameters{goal, 2}, robot.limits), std::make_unique<Internal>(), {},
       std::make_unique<FinalJoint>(FinalJoint::Parameters{Vector7::Constant(1e-3)}));
  ASSERT_TRUE(until_result(6000));
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_EQ(results[0].termination, -1) << "which has not fired";
  EXPECT_GT(results[0].left.joints.value_or(0), 0.1);
}

TEST_F(LoopTest, WhatIsInTheWayOfATrajectoryIsNoEndOfTheOneThatItIsChangedFor) {
  auto walls = std::make_unique<Walls>(Walls{ArmCapsules(models::arm("fr3"), true), {}});
  walls->walls.push_back({1, testing_tools::plane({0, 0.25, 0}, -Vector3::UnitY())});
  door.walls.put(std::move(walls));
  const Vector7 home = robot.q();
  const MinJerkJoint::Parameters there{home + Vector7::Unit(0), 2};
  const std::uint64_t id = give(std::make_unique<OddTrajectory>(there, robot.limits, OddTrajectory::kNeverEnds), std::make_unique<Internal>());
  cycles(5000);
  ASSERT_EQ(results_seen, 0u);
  ASSERT_GT(robot.q()[0] - home[0], 0.1);
  auto change = std::make_unique<Change>();
  change->skill_id = id;
  change->trajectory = std::make_unique<LinearTrajectory>(MinJerkJoint::Parameters{home, 2}, robot.limits);
  door.change.put(std::move(change));
  cycles(100);
  EXPECT_EQ(results_seen, 0u);
  Change* const* changed = door.changed.front();
  ASSERT_TRUE(changed != nullptr);
  EXPECT_TRUE((*changed)->done);
  delete *changed;
  door.changed.pop();
  ASSERT_TRUE(until_result(6000));
  EXPECT_NEAR((robot.q() - home).norm(), 0, 1e-3) << "each joint for itself would have come nearer to the wall, and stood";
}

TEST_F(LoopTest, APathThatIsFasterThanTheJointsIsWaitedFor) {
  models::Limits careless = robot.limits;  // of who planned it
  for (auto* most : {&careless.dq_max, &careless.ddq_max, &careless.dddq_max}) most->fill(1e6);
  careless.envelope_deceleration.fill(0);
  const Vector7 from = robot.q(), way = (Vector7() << 2.2, 0.2, -0.4, 0.3, 0.05, -0.2, 0.6).finished();
  give(std::make_unique<MinJerkJoint>(MinJerkJoint::Parameters{from + way, 0.2}, careless), std::make_unique<Internal>());
  double bent = 0;
  while (results_seen == 0 && cycle()) {
    const Vector7 along = robot.q() - from;
    bent = std::max(bent, (along - along.dot(way) / way.squaredNorm() * way).cwiseAbs().maxCoeff());
  }
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_GT(results[0].limited_cycles, 100u) << "the joints were in the way";
  EXPECT_EQ(results[0].held_by, realtime::HeldBy::kMotionLimits);
  EXPECT_LT(bent, 0.15) << "0.32 where nothing waits";
  EXPECT_NEAR((robot.q() - from - way).norm(), 0, 1e-6);
}

TEST_F(LoopTest, PosesKeepTheJointsInsideTheirLimitsUnderTorqueToo) {
  // Past the base at arm's length and back, faster than the joints could.
  give(to_pose({-0.25, -0.45, 0.1}, 0.3), std::make_unique<PoseSpring>());
  ASSERT_TRUE(until(Phase::kRunning));
  Vector7 last_q = robot.q();
  double worst = 0;
  while (results_seen == 0 && cycle()) {
    const Vector7 speed = (robot.q() - last_q) / 1e-3;
    last_q = robot.q();
    for (int i = 0; i < 7; ++i) worst = std::max(worst, std::abs(speed[i]) / robot.limits.dq_max[i]);
  }
  EXPECT_LT(worst, 1);
  judge = false;
}

// A soft law lets the arm be elsewhere than at q_d, from where a stiff one would tear it with 150 N m.
TEST_F(LoopTest, ASofterArmIsLetGoWhereItIsBeforeAStifferLawTakesIt) {
  give_internal(0.01, 0.1, stiffness(70));
  ASSERT_TRUE(until(Phase::kIdle, 5000));
  robot.yields = 0.05 * Vector7::Unit(3);
  ASSERT_TRUE(cycle());
  const Vector7 q = robot.q() + robot.yields;
  give_internal(0.01, 0.1, stiffness(3000));
  ASSERT_TRUE(until([&] { return robot.in_motion(); }, 100));
  EXPECT_EQ(robot.moved, robot::kTorque);
  ASSERT_TRUE(until([&] { return robot.moved == kInternalJoint && robot.in_motion(); }, 100));
  EXPECT_LT((Vector7::Map(robot.state.q_d.data()) - q).norm(), 1e-3);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[1].ending, Ending::kTerminated);
  EXPECT_EQ(results[1].skill_id, 2u);
  EXPECT_NEAR(results[1].time, 0.1, 0.01);
  EXPECT_LT((robot.q() - q - Vector7::Constant(0.01)).norm(), 1e-3);
  EXPECT_EQ(posted(fci::Command::kMove), 3);
}

TEST_F(LoopTest, AnArmThatIsBeingLetGoTakesAnotherSkillAndStops) {
  give_internal(0.01, 0.1, stiffness(70));
  ASSERT_TRUE(until(Phase::kIdle, 5000));
  const auto let_go = [&] {
    robot.yields = 0.05 * Vector7::Unit(3);
    cycle();
    give_internal(0.01, 0.1, stiffness(3000));
    return until([&] { return robot.in_motion() && robot.moved == robot::kTorque; }, 100);
  };
  ASSERT_TRUE(let_go());
  give_torque(0.01, 0.1);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[1].ending, Ending::kPreempted);
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[2].ending, Ending::kTerminated);
  ASSERT_TRUE(until(Phase::kIdle, 5000));
  ASSERT_TRUE(let_go());
  door.stop_up_to = given;
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[3].ending, Ending::kStopped);
  ASSERT_TRUE(until(Phase::kIdle, 1000));
  EXPECT_FALSE(robot.in_motion());
  give_internal(0.01, 0.1, stiffness(3000));
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[4].ending, Ending::kTerminated);
}

TEST_F(LoopTest, AnArmThatAnUnknownLoadPullsAtRestsWhenItIsLetGo) {
  give_internal(0.01, 0.1, stiffness(70));
  ASSERT_TRUE(until(Phase::kIdle, 5000));
  robot.yields = 0.05 * Vector7::Unit(3);
  robot.load = 4 * Vector7::Unit(6);
  ASSERT_TRUE(cycle());
  const Vector7 q = robot.q() + robot.yields;
  give_internal(0.01, 0.1, stiffness(3000));
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[1].ending, Ending::kTerminated);
  EXPECT_GT((robot.q() - q).norm(), 0.1) << "it moved";
  EXPECT_LT((robot.q() - q).norm(), 0.3);
  EXPECT_FALSE(robot.finished_while_moving);
}

TEST_F(LoopTest, AWrongEstimateIsNoReasonToLetGoAnArmThatIsWhereItShouldBe) {
  give_internal(0.01, 0.1, stiffness(70));
  ASSERT_TRUE(until(Phase::kIdle, 5000));
  robot.state.tau_ext_hat_filtered[3] = -60;
  ASSERT_TRUE(cycle());
  give_internal(0.01, 0.1, stiffness(3000));
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[1].ending, Ending::kTerminated);
  EXPECT_EQ(posted(fci::Command::kMove), 2);
}

TEST_F(LoopTest, AnArmThatAnUnknownLoadPullsAtRestsAfterAFault) {
  robot.load = 6 * Vector7::Unit(3);
  auto controller = std::make_unique<BrokenController>(gains());
  controller->from = 0.1;
  give(by(0.01, 0.3), std::move(controller));
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[0].ending, Ending::kComponentFault);
  ASSERT_TRUE(until(Phase::kIdle, 5000));
  EXPECT_FALSE(robot.finished_while_moving);
}

TEST_F(LoopTest, AnArmThatDoesNotComeToRestIsStoppedByTheRobot) {
  const auto shake = [&](int most) {
    for (int k = 0; k < most && last.phase != Phase::kIdle; ++k) {
      robot.load << 0, 0, 0, 0, 0, 8 * std::sin(0.2 * k), 8 * std::cos(0.2 * k);
      ASSERT_TRUE(cycle());
    }
  };
  give(by(0.01, 0.1), std::make_unique<JointImpedance>(gains()));
  ASSERT_TRUE(until_result());
  const std::uint64_t end = robot.state.message_id;
  shake(6000);
  EXPECT_EQ(last.phase, Phase::kIdle);
  EXPECT_LT(robot.state.message_id - end, 5010u);
  EXPECT_EQ(posted(fci::Command::kStopMove), 1);
  EXPECT_FALSE(robot.finished_while_moving);
  robot.load.setZero();
  give(by(0.01, 0.1), std::make_unique<JointImpedance>(gains()));
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[1].ending, Ending::kTerminated);
  ASSERT_TRUE(until(Phase::kIdle, 5000));
  EXPECT_EQ(posted(fci::Command::kStopMove), 1);
}

TEST_F(LoopTest, AnArmThatALoadHoldsAwayFromItsReferenceIsNotLetGo) {
  give_internal(0.01, 0.1, stiffness(1000));
  ASSERT_TRUE(until(Phase::kIdle, 5000));
  robot.yields = 0.03 * Vector7::Unit(3);
  robot.state.tau_ext_hat_filtered[3] = -30;  // that the arm exerts, as its law asks for it
  ASSERT_TRUE(cycle());
  give_internal(0.01, 0.1, stiffness(1000));
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[1].ending, Ending::kTerminated);
  EXPECT_EQ(posted(fci::Command::kMove), 2);
}

class OldRobot : public LoopTest {
 protected:
  OldRobot() : LoopTest(5) {}
};

TEST_F(OldRobot, RunsTorqueBesideJointVelocitiesOfZero) {
  give_torque();
  ASSERT_TRUE(until_result());
  EXPECT_EQ(results[0].ending, Ending::kTerminated);
  EXPECT_EQ(robot.moved, (robot::Mode{fci::ControllerMode::kExternal, Generator::kJointVelocity}));
  give_internal();
  ASSERT_TRUE(until_result());
  EXPECT_EQ(robot.moved, kInternalJoint);
}

class NoHold : public LoopTest {
 protected:
  NoHold() : LoopTest(10, 0) {}
};

TEST_F(NoHold, FinishesAtOnce) {
  give_internal();
  ASSERT_TRUE(until_result());
  ASSERT_TRUE(until(Phase::kIdle, 4));
}

}  // namespace
