#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <random>
#include <thread>

#include "server/publisher.hpp"
#include "server/recorder.hpp"
#include "server/sensor_hub.hpp"
#include "server/transport.hpp"
#include "tests/server/client.hpp"
#include "tests/server/gate.hpp"
#include "tests/server/skills.hpp"

namespace server {
namespace {

using namespace std::chrono_literals;

// The server's threads at a door whose other side is the test.
class TransportTest : public testing::Test {
 protected:
  TransportTest() {
    thread_ = std::thread([this] { transport_.run(quit_); });
    connect();
  }
  ~TransportTest() override {
    quit_ = true;
    thread_.join();
  }

  void connect() {
    proto::Welcome welcome;
    welcome.set_arm("test arm");
    welcome.set_model("fr3");
    transport_.connected(std::make_shared<SkillBuilder>(fr3_model(), fr3_limits()), welcome);
    publish();
  }

  // A cycle of the loop.
  void publish() {
    ++record_.cycles;
    ++record_.state.message_id;
    door_.records.push(record_);
  }

  // The robot stops with that error, and is ready again.
  void fail(fci::Error error) {
    record_.phase = realtime::Phase::kError;
    record_.state.robot_mode = fci::RobotMode::kReflex;
    record_.state.errors = {};
    record_.state.errors[static_cast<std::size_t>(error)] = true;
    publish();
  }
  void get_well() {
    record_.phase = realtime::Phase::kIdle;
    record_.state.robot_mode = fci::RobotMode::kIdle;
    record_.state.errors = {};
    publish();
  }
  // What the loop says, once it is asked to recover: with the newest record.
  void answer(realtime::RecoveryResult result) {
    while (!door_.recover.exchange(false)) std::this_thread::sleep_for(100us);
    result.record = door_.records.written() - 1;
    door_.recoveries.push(result);
  }
  static proto::Request recover() {
    proto::Request request;
    request.mutable_recover();
    return request;
  }

  // The skill that waits at the door, as the loop takes it.
  std::unique_ptr<realtime::Skill> take() {
    return std::unique_ptr<realtime::Skill>(door_.next.take());
  }

  void finish(std::unique_ptr<realtime::Skill> skill, realtime::Ending ending = realtime::Ending::kTerminated,
              int termination = -1) {
    door_.results.push({.skill_id = skill->id, .ending = ending, .termination = termination, .time = 1.5});
    door_.retired.push(skill.release());
  }

  Client stranger() { return Client(context_, transport_.endpoint()); }
  Client client() {
    Client client = stranger();
    EXPECT_TRUE(client.hello().has_welcome());
    return client;
  }

  void publish_until_heard(auto& subscriber) {
    while (!subscriber.next(zmq::recv_flags::dontwait)) {
      publish();
      std::this_thread::sleep_for(1ms);
    }
  }

  zmq::context_t context_;
  BlackBox box_;
  realtime::Door door_{box_.records};
  realtime::Record record_ = record_at_home();
  Publisher publisher_{context_, "127.0.0.1", 0, door_, nullptr};
  SensorHub sensors_{context_, "127.0.0.1", 0, box_.journal, door_.robot_time, false};
  Recorder recorder_{box_, RecordingsConfig{.mode = RecordingsConfig::Mode::kOff, .folder = {}}, "arm", nullptr};
  std::atomic<std::chrono::milliseconds> time_{0ms};  // that leases go by
  Transport transport_{context_, "127.0.0.1", 0, door_, publisher_, sensors_, recorder_, nullptr, WallStore({}),
                       {.lease_time = 800ms, .clock = [this] { return time_.load(); }}};
  std::atomic<bool> quit_{false};
  std::thread thread_;
  const proto::Skill skill_ = skill_of(joint_motion(), proto::JointImpedance());
};

TEST_F(TransportTest, HelloComesFirst) {
  auto one = stranger();
  EXPECT_EQ(one.state().error().code(), proto::Error::UNKNOWN_CLIENT);
  EXPECT_EQ(one.start(skill_).error().code(), proto::Error::UNKNOWN_CLIENT);
  const auto reply = one.hello();
  EXPECT_EQ(reply.welcome().version(), proto::CURRENT);
  EXPECT_EQ(reply.welcome().arm(), "test arm");
  EXPECT_EQ(reply.welcome().state_endpoint(), publisher_.endpoint());
  EXPECT_TRUE(one.state().has_state());
}

TEST_F(TransportTest, AnotherVersionIsRefusedWithBoth) {
  auto old = stranger();
  proto::Request request;
  request.mutable_hello();
  EXPECT_EQ(old.ask(request).error().code(), proto::Error::INCOMPATIBLE_VERSION);

  auto newer = stranger();
  request.mutable_hello()->GetReflection()->MutableUnknownFields(request.mutable_hello())->AddVarint(1, 77);
  const auto reply = newer.ask(request);
  EXPECT_EQ(reply.error().code(), proto::Error::INCOMPATIBLE_VERSION);
  EXPECT_NE(reply.error().message().find("interface version 77, this server 1"), std::string::npos)
      << reply.error().message();
  EXPECT_EQ(newer.state().error().code(), proto::Error::UNKNOWN_CLIENT);
}

TEST_F(TransportTest, ASkillIsStartedAndItsResultComesBack) {
  auto a = client();
  auto message = skill_;
  message.set_description("wave");
  message.add_terminations()->PackFrom(proto::FinalJoint());
  const auto started = a.start(message);
  ASSERT_TRUE(started.has_skill_started()) << started.DebugString();
  auto skill = take();
  ASSERT_NE(skill, nullptr);
  EXPECT_EQ(skill->id, started.skill_started().skill_id());

  record_.skill_id = skill->id;
  record_.phase = realtime::Phase::kRunning;
  publish();
  const auto state = a.state().state();
  EXPECT_EQ(state.skill_description(), "wave");
  EXPECT_EQ(state.skill_parts().trajectory(), "MinJerkJoint");
  EXPECT_EQ(state.skill_parts().controller(), "JointImpedance");
  ASSERT_EQ(state.skill_parts().terminations_size(), 1);
  EXPECT_EQ(state.skill_parts().terminations(0), "FinalJoint");
  EXPECT_EQ(state.phase(), proto::RUNNING);
  EXPECT_GE(state.age(), 0);

  proto::Request status;
  status.mutable_skill_status()->set_skill_id(skill->id);
  EXPECT_TRUE(a.ask(status).has_done());

  const auto id = skill->id;
  finish(std::move(skill), realtime::Ending::kTerminated, 0);
  const auto result = a.receive();
  EXPECT_EQ(result.request_id(), started.request_id());
  EXPECT_EQ(result.skill_result().skill_id(), id);
  EXPECT_EQ(result.skill_result().ending(), proto::TERMINATED);
  EXPECT_EQ(result.skill_result().termination(), "FinalJoint");
  EXPECT_EQ(result.skill_result().time(), 1.5);
  EXPECT_TRUE(result.skill_result().has_last_state());
  EXPECT_EQ(a.ask(status).skill_result().time(), 1.5);
}

TEST_F(TransportTest, AResultIsToldWithTheStateOfTheCycleThatEndedIt) {
  auto a = client();
  a.start(skill_);
  auto skill = take();
  ASSERT_NE(skill, nullptr);
  record_.phase = realtime::Phase::kRunning;
  publish();
  // As the loop does: the result first, and the record of its cycle after it.
  door_.results.push({.skill_id = skill->id, .ending = realtime::Ending::kRobotError, .record = door_.records.written()});
  door_.retired.push(skill.release());
  a.state();  // a round of the server
  record_.phase = realtime::Phase::kError;
  publish();
  const auto ended = record_.cycles;
  record_.phase = realtime::Phase::kIdle;
  publish();
  const auto result = a.receive();
  EXPECT_EQ(result.skill_result().last_state().phase(), proto::ERROR);
  EXPECT_EQ(result.skill_result().last_state().cycles(), ended);
}

TEST_F(TransportTest, WhatIsRefusedDoesNotReachTheDoor) {
  auto a = client();
  auto bad = skill_;
  auto motion = joint_motion();
  motion.set_q(2, std::numeric_limits<double>::quiet_NaN());
  bad.mutable_trajectory()->PackFrom(motion);
  const auto reply = a.start(bad);
  EXPECT_EQ(reply.error().code(), proto::Error::INVALID_ARGUMENT);
  EXPECT_NE(reply.error().message().find("MinJerkJoint.q[2] is nan"), std::string::npos) << reply.error().message();
  EXPECT_EQ(take(), nullptr);
  EXPECT_TRUE(a.start(skill_).has_skill_started());
  EXPECT_NE(take(), nullptr);
}

TEST_F(TransportTest, AnotherSkillOfTheSameClientNeedsPreempt) {
  auto a = client();
  const auto first = a.start(skill_);
  auto running = take();
  EXPECT_EQ(a.start(skill_).error().code(), proto::Error::BUSY);
  EXPECT_EQ(take(), nullptr);
  EXPECT_TRUE(a.start(skill_, true).has_skill_started());
  finish(std::move(running), realtime::Ending::kPreempted);
  EXPECT_EQ(a.receive().skill_result().skill_id(), first.skill_started().skill_id());
  finish(take());
  EXPECT_EQ(a.receive().skill_result().ending(), proto::TERMINATED);
}

TEST_F(TransportTest, ASkillThatTheLoopHasNotTakenIsPreemptedToo) {
  auto a = client();
  const auto first = a.start(skill_);
  proto::Request request;
  *request.mutable_start_skill()->mutable_skill() = skill_;
  request.mutable_start_skill()->set_preempt(true);
  EXPECT_TRUE(a.ask(request).has_skill_started());
  const auto result = a.receive();
  EXPECT_EQ(result.request_id(), first.request_id());
  EXPECT_EQ(result.skill_result().ending(), proto::PREEMPTED);
}

TEST_F(TransportTest, QueuedSkillsAreHandedOnOneByOne) {
  auto a = client();
  const auto first = a.start(skill_).skill_started().skill_id();
  auto running = take();
  const auto second = a.start_after(skill_, first).skill_started().skill_id();
  const auto third = a.start_after(skill_, second).skill_started().skill_id();
  std::unique_ptr<realtime::Skill> waiting(door_.queued.take());
  ASSERT_NE(waiting, nullptr);
  EXPECT_EQ(waiting->id, second);
  EXPECT_EQ(waiting->after, first);
  EXPECT_TRUE(door_.next.empty());
  finish(std::move(running));
  EXPECT_EQ(a.receive().skill_result().skill_id(), first);
  while (door_.queued.empty()) std::this_thread::sleep_for(100us);
  const std::unique_ptr<realtime::Skill> last(door_.queued.take());
  EXPECT_EQ(last->id, third);
  EXPECT_EQ(last->after, second);
}

TEST_F(TransportTest, WhatWaitsForAFailureIsCancelled) {
  auto a = client();
  const auto first = a.start(skill_).skill_started().skill_id();
  auto running = take();
  const auto second = a.start_after(skill_, first).skill_started().skill_id();
  const auto third = a.start_after(skill_, second).skill_started().skill_id();
  std::unique_ptr<realtime::Skill> waiting;
  while (!waiting) waiting.reset(door_.queued.take());
  finish(std::move(running), realtime::Ending::kRobotError);
  finish(std::move(waiting), realtime::Ending::kCancelled);  // as the loop does
  for (const auto& [id, ending] : {std::pair{first, proto::ROBOT_ERROR}, {second, proto::CANCELLED}, {third, proto::CANCELLED}}) {
    const auto result = a.receive().skill_result();
    EXPECT_EQ(result.skill_id(), id);
    EXPECT_EQ(result.ending(), ending);
  }
  EXPECT_TRUE(a.start_after(skill_, third).has_skill_started());  // which came too late
  EXPECT_EQ(a.receive().skill_result().ending(), proto::CANCELLED);
  EXPECT_EQ(take(), nullptr);
  EXPECT_TRUE(a.start(skill_).has_skill_started());
}

TEST_F(TransportTest, WhatIsQueuedWronglyIsRefused) {
  auto a = client();
  EXPECT_EQ(a.start_after(skill_, 7).error().code(), proto::Error::INVALID_ARGUMENT);
  const auto first = a.start(skill_).skill_started().skill_id();
  const auto second = a.start_after(skill_, first).skill_started().skill_id();
  const auto reply = a.start_after(skill_, first);
  EXPECT_EQ(reply.error().code(), proto::Error::INVALID_ARGUMENT);
  EXPECT_EQ(reply.error().message(), "StartSkill.after = " + std::to_string(first) +
                                         ": expected the last skill of this client, " + std::to_string(second));
  EXPECT_EQ(a.start(skill_).error().code(), proto::Error::BUSY);
}

TEST_F(TransportTest, WhatTakesOverDropsTheQueue) {
  auto a = client();
  const auto first = a.start(skill_).skill_started().skill_id();
  auto running = take();
  const auto second = a.start_after(skill_, first).skill_started().skill_id();
  const auto third = a.start_after(skill_, second).skill_started().skill_id();
  proto::Request request;
  *request.mutable_start_skill()->mutable_skill() = skill_;
  request.mutable_start_skill()->set_preempt(true);
  a.send(request);
  for (const auto id : {second, third}) {
    const auto result = a.receive().skill_result();
    EXPECT_EQ(result.skill_id(), id);
    EXPECT_EQ(result.ending(), proto::PREEMPTED);
  }
  EXPECT_TRUE(a.receive().has_skill_started());
  EXPECT_TRUE(door_.queued.empty());
}

TEST_F(TransportTest, OneClientCommandsAndAnyNumberRead) {
  auto a = client(), b = client();
  ASSERT_TRUE(a.start(skill_).has_skill_started());
  const auto refused = b.start(skill_, true);
  EXPECT_EQ(refused.error().code(), proto::Error::BUSY);
  EXPECT_NE(refused.error().message().find("test"), std::string::npos) << refused.error().message();
  EXPECT_EQ(b.recover().error().code(), proto::Error::BUSY);
  EXPECT_TRUE(b.state().has_state());

  // Its skill runs on when it goes, and the next commander's takes over.
  EXPECT_TRUE(a.say_goodbye().has_done());
  auto running = take();
  EXPECT_TRUE(b.start(skill_).has_skill_started());
  finish(std::move(running), realtime::Ending::kPreempted);
  finish(take());
  EXPECT_EQ(b.receive().skill_result().ending(), proto::TERMINATED);
}

TEST_F(TransportTest, ASilentClientLosesTheLease) {
  auto a = client(), b = client();
  ASSERT_TRUE(a.start(skill_).has_skill_started());
  finish(take());
  EXPECT_TRUE(a.receive().has_skill_result());
  time_ = 799ms;
  EXPECT_EQ(b.start(skill_).error().code(), proto::Error::BUSY);
  EXPECT_TRUE(a.state().has_state());  // which is a word
  time_ = 1598ms;
  EXPECT_EQ(b.start(skill_).error().code(), proto::Error::BUSY);
  time_ = 1600ms;
  EXPECT_TRUE(b.state().has_state());  // a round in which it has been silent for so long
  EXPECT_TRUE(b.start(skill_).has_skill_started());
  EXPECT_EQ(a.start(skill_).error().code(), proto::Error::BUSY);
}

// --- what takes long ---

// The gate is there before the server's threads are.
struct Gated {
  Gate gate;
};
class GatedTransportTest : public Gated, public TransportTest {
 protected:
  explicit GatedTransportTest(const std::string& kind = "StayJoint") : Gated{Gate(kind)} {}
  void TearDown() override { gate.open(); }
};

TEST_F(GatedTransportTest, AStopDoesNotWaitForWhatIsBuilt) {
  auto a = client(), b = client(), c = client();
  proto::StayJoint stay;
  stay.set_duration(1);
  const auto start = [&](Client& client) {
    proto::Request request;
    *request.mutable_start_skill()->mutable_skill() = skill_of(stay, proto::JointImpedance());
    return client.send(request);
  };
  const auto first = start(a);
  gate.wait_for(1);
  const auto second = start(b);
  EXPECT_TRUE(b.state().has_state()) << "others are served, and it too";
  EXPECT_EQ(door_.stop_up_to.load(), 0u);
  EXPECT_TRUE(c.stop().has_done());
  const auto stopped = door_.stop_up_to.load();
  EXPECT_GE(stopped, 2u);

  // Both were asked for before the stop: of what is built after it the loop runs nothing.
  gate.open();
  const auto started = a.receive();
  EXPECT_EQ(started.request_id(), first);
  EXPECT_LE(started.skill_started().skill_id(), stopped);
  EXPECT_EQ(b.receive().request_id(), second);
  finish(take(), realtime::Ending::kStopped);
  EXPECT_EQ(a.receive().skill_result().ending(), proto::STOPPED);
  EXPECT_GT(a.start(skill_).skill_started().skill_id(), stopped) << "one that is asked for after it runs";
}

TEST_F(GatedTransportTest, OneRequestOfAClientIsBuiltAtATime) {
  auto a = client(), b = client();
  proto::Request request;
  proto::StayJoint stay;
  stay.set_duration(1);
  *request.mutable_start_skill()->mutable_skill() = skill_of(stay, proto::JointImpedance());
  const auto first = a.send(request);
  gate.wait_for(1);
  const auto refused = a.start(skill_);
  EXPECT_EQ(refused.error().code(), proto::Error::BUSY);
  EXPECT_NE(refused.error().message().find("another request of this client is being looked at"), std::string::npos)
      << refused.error().message();
  const auto second = b.send(request);  // the lease is free still
  EXPECT_TRUE(b.state().has_state());
  gate.open();
  auto reply = a.receive();
  EXPECT_EQ(reply.request_id(), first);
  EXPECT_TRUE(reply.has_skill_started());
  reply = b.receive();
  EXPECT_EQ(reply.request_id(), second);
  EXPECT_EQ(reply.error().code(), proto::Error::BUSY) << "meanwhile the other one commands";
}

TEST_F(GatedTransportTest, WhatIsBuiltForARobotThatIsGoneIsRefused) {
  auto a = client();
  proto::Request request;
  proto::StayJoint stay;
  stay.set_duration(1);
  *request.mutable_start_skill()->mutable_skill() = skill_of(stay, proto::JointImpedance());
  a.send(request);
  gate.wait_for(1);
  transport_.disconnected("the robot is gone");
  connect();
  gate.open();
  EXPECT_EQ(a.receive().error().code(), proto::Error::NOT_READY);
  EXPECT_EQ(take(), nullptr);
}

TEST_F(TransportTest, UnreachableGoalsKeepNobodyWaiting) {
  auto a = client(), b = client();
  proto::Request request;
  *request.mutable_start_skill()->mutable_skill() = skill_of(pose_motion(1.9, 0, 0), proto::CartesianImpedance());
  constexpr int kGoals = 64;
  for (int i = 0; i < kGoals; ++i) a.send(request);
  EXPECT_TRUE(b.stop().has_done());
  EXPECT_TRUE(b.state().has_state());
  int unreachable = 0, busy = 0;
  for (int i = 0; i < kGoals; ++i) {
    const auto error = a.receive().error();
    const bool looked_at = error.message().find("out of the arm's reach") != std::string::npos;
    EXPECT_EQ(error.code(), looked_at ? proto::Error::INVALID_ARGUMENT : proto::Error::BUSY) << error.message();
    (looked_at ? unreachable : busy) += 1;
  }
  EXPECT_GE(unreachable, 1);
  EXPECT_EQ(unreachable + busy, kGoals);
  EXPECT_EQ(take(), nullptr);
  EXPECT_TRUE(a.start(skill_).has_skill_started());
}

TEST_F(TransportTest, ALargeRequestIsReadAsASmallOneIs) {
  auto a = client();
  proto::Request request;
  request.mutable_start_skill()->mutable_skill()->set_description(std::string(1 << 20, 'x'));
  auto reply = a.ask(request);
  EXPECT_EQ(reply.error().code(), proto::Error::INVALID_ARGUMENT);
  EXPECT_NE(reply.error().message().find("Skill.description has 1048576 bytes"), std::string::npos) << reply.error().message();
  request.mutable_hello()->set_client(std::string(1 << 20, 'x'));
  EXPECT_EQ(stranger().ask(request).error().code(), proto::Error::UNKNOWN_CLIENT);
  std::string bytes = "\x08\x05\x22";  // request 5, then a StartSkill that ends before it should
  bytes += std::string(1 << 20, '\xff');
  a.send_bytes(bytes);
  reply = a.receive();
  EXPECT_EQ(reply.request_id(), 5u);
  EXPECT_EQ(reply.error().code(), proto::Error::INVALID_ARGUMENT);
}

TEST_F(TransportTest, EveryClientMayStop) {
  auto a = client(), b = client();
  const auto started = a.start(skill_);
  EXPECT_TRUE(b.stop().has_done());
  EXPECT_EQ(door_.stop_up_to.load(), started.skill_started().skill_id());
  finish(take(), realtime::Ending::kStopped);
  EXPECT_EQ(a.receive().skill_result().ending(), proto::STOPPED);
}

TEST_F(TransportTest, AnArmInErrorWaitsForRecovery) {
  auto a = client();
  fail(fci::Error::kJointVelocityLimitsCommanded);
  const auto refused = a.start(skill_);
  EXPECT_EQ(refused.error().code(), proto::Error::NOT_READY);
  EXPECT_NE(refused.error().message().find("velocity_limits"), std::string::npos) << refused.error().message();

  const auto id = a.send(recover());
  answer({.recovered = false, .status = fci::Status::kNotPossible, .robot_mode = fci::RobotMode::kReflex});
  auto reply = a.receive();
  EXPECT_EQ(reply.request_id(), id);
  EXPECT_FALSE(reply.recovery().recovered());
  EXPECT_EQ(reply.recovery().obstacle(), proto::IN_REFLEX);
  EXPECT_NE(reply.recovery().message().find("refused AutomaticErrorRecovery"), std::string::npos) << reply.recovery().message();

  a.send(recover());
  get_well();
  answer({.recovered = true});
  const auto recovery = a.receive().recovery();
  EXPECT_TRUE(recovery.recovered());
  EXPECT_FALSE(recovery.by_itself());
}

TEST_F(TransportTest, WhatPeopleHaveToDoIsToldInItsOrder) {
  auto a = client();
  record_.phase = realtime::Phase::kError;
  const auto obstacle = [&](fci::RobotMode mode) {
    record_.state.robot_mode = mode;
    publish();
    const auto recovery = a.ask(recover()).recovery();
    EXPECT_FALSE(recovery.recovered());
    EXPECT_NE(recovery.message().find("then recover"), std::string::npos) << recovery.message();
    return recovery.obstacle();
  };
  EXPECT_EQ(obstacle(fci::RobotMode::kGuiding), proto::HELD_BY_HAND);
  EXPECT_EQ(obstacle(fci::RobotMode::kUserStopped), proto::STOPPED_BY_USER);
  EXPECT_EQ(obstacle(fci::RobotMode::kOther), proto::NOT_ACTIVE);
  EXPECT_FALSE(door_.recover) << "the robot would refuse";
}

TEST_F(TransportTest, AfterAnErrorTheArmRecoversByItselfAsOftenAsItsSkillsLetIt) {
  auto a = client();
  auto message = skill_;
  message.mutable_recovery()->set_who(proto::RecoveryPolicy::ITSELF);
  message.mutable_recovery()->set_times(2);
  for (unsigned n = 1; n <= 2; ++n) {
    a.start(message);
    auto skill = take();
    fail(fci::Error::kCommunicationConstraints);
    finish(std::move(skill), realtime::Ending::kRobotError);
    while (!door_.recover.load()) std::this_thread::sleep_for(100us);
    EXPECT_EQ(a.start(skill_).error().code(), proto::Error::NOT_READY) << "it is not over";
    get_well();
    answer({.recovered = true});
    const auto result = a.receive().skill_result();
    EXPECT_EQ(result.ending(), proto::ROBOT_ERROR);
    EXPECT_TRUE(result.recovery().recovered() && result.recovery().by_itself());
    EXPECT_EQ(result.recovery().in_a_row(), n);
    EXPECT_GT(result.recovery().time(), 0);
    EXPECT_NE(result.message().find("it has recovered by itself"), std::string::npos) << result.message();
  }
  a.start(message);
  auto skill = take();
  fail(fci::Error::kCommunicationConstraints);
  finish(std::move(skill), realtime::Ending::kRobotError);
  const auto recovery = a.receive().skill_result().recovery();
  EXPECT_FALSE(recovery.recovered());
  EXPECT_EQ(recovery.obstacle(), proto::IN_REFLEX);
  EXPECT_EQ(recovery.who(), proto::RecoveryPolicy::ASK) << "too often";
  EXPECT_FALSE(door_.recover);

  a.send(recover());
  get_well();
  answer({.recovered = true});
  EXPECT_TRUE(a.receive().recovery().recovered());
  a.start(message);  // and once a person has looked
  skill = take();
  fail(fci::Error::kCommunicationConstraints);
  finish(std::move(skill), realtime::Ending::kRobotError);
  while (!door_.recover.load()) std::this_thread::sleep_for(100us);
  get_well();
  answer({.recovered = true});
  EXPECT_EQ(a.receive().skill_result().recovery().in_a_row(), 1u);
}

TEST_F(TransportTest, WhatIsCancelledBehindAnErrorDoesNotChangeWhoRecovers) {
  auto a = client();
  auto message = skill_;
  message.mutable_recovery()->set_who(proto::RecoveryPolicy::NEVER);
  const auto first = a.start(message).skill_started().skill_id();
  auto skill = take();
  ASSERT_TRUE(a.start_after(skill_, first).has_skill_started());
  fail(fci::Error::kCommunicationConstraints);
  finish(std::move(skill), realtime::Ending::kRobotError);
  EXPECT_EQ(a.receive().skill_result().recovery().who(), proto::RecoveryPolicy::NEVER);
  finish(std::unique_ptr<realtime::Skill>(door_.queued.take()), realtime::Ending::kCancelled);
  EXPECT_EQ(a.receive().skill_result().ending(), proto::CANCELLED);
  EXPECT_FALSE(a.ask(recover()).recovery().recovered());
  EXPECT_FALSE(door_.recover);
}

TEST_F(TransportTest, ASkillThatHadNotBegunHasNoSayInWhoRecovers) {
  auto a = client();
  auto message = skill_;
  message.mutable_recovery()->set_who(proto::RecoveryPolicy::NEVER);
  a.start(message);
  auto ran = take();
  message.mutable_recovery()->set_who(proto::RecoveryPolicy::ITSELF);
  const auto waits = a.start(message, true).skill_started().skill_id();
  auto waited = take();
  fail(fci::Error::kCommunicationConstraints);
  const std::uint64_t record = door_.records.written() - 1;
  for (auto* skill : {&ran, &waited}) {
    door_.results.push({.skill_id = (*skill)->id, .ending = realtime::Ending::kRobotError, .record = record});
    door_.retired.push(skill->release());
  }
  for (int n = 0; n < 2; ++n) {
    const auto result = a.receive().skill_result();
    EXPECT_EQ(result.recovery().who(), proto::RecoveryPolicy::NEVER) << (result.skill_id() == waits ? "waited" : "ran");
  }
  EXPECT_FALSE(a.ask(recover()).recovery().recovered());
  EXPECT_EQ(door_.recover, 0u);
}

TEST_F(TransportTest, AnErrorThatCameSinceIsNotRecoveredFrom) {
  auto a = client();
  a.send(recover());  // from nothing
  while (!door_.recover.load()) std::this_thread::sleep_for(100us);
  EXPECT_EQ(door_.recover, record_.cycles);
  fail(fci::Error::kJointReflex);
  answer({.recovered = false, .unseen = true, .robot_mode = fci::RobotMode::kReflex});
  const auto recovery = a.receive().recovery();
  EXPECT_FALSE(recovery.recovered());
  EXPECT_EQ(recovery.obstacle(), proto::IN_REFLEX);
  EXPECT_NE(recovery.message().find("then recover"), std::string::npos) << recovery.message();
}

TEST_F(TransportTest, AfterAStopWhileItRecoversNothingIsMovedBack) {
  auto a = client(), b = client();
  fail(fci::Error::kJointPositionLimits);
  record_.state.q[3] = fr3_limits().q_max[3] + 0.005;
  a.send(recover());
  while (!door_.recover.load()) std::this_thread::sleep_for(100us);
  get_well();
  proto::Request stop;
  stop.mutable_stop_skill();
  EXPECT_TRUE(b.ask(stop).has_done());
  answer({.recovered = true});
  const auto recovery = a.receive().recovery();
  EXPECT_FALSE(recovery.recovered());
  EXPECT_NE(recovery.message().find("stop was asked for"), std::string::npos) << recovery.message();
  EXPECT_EQ(take(), nullptr);
}

TEST_F(TransportTest, AStopRightBehindARecoveryCountsForIt) {
  auto a = client();
  fail(fci::Error::kJointPositionLimits);
  record_.state.q[3] = fr3_limits().q_max[3] + 0.005;
  proto::Request stop;
  stop.mutable_stop_skill();
  a.send(recover());
  a.send(stop);  // is urgent: may be read first
  EXPECT_TRUE(a.receive().has_done());
  while (!door_.recover.load()) std::this_thread::sleep_for(100us);
  get_well();
  answer({.recovered = true});
  const auto recovery = a.receive().recovery();
  EXPECT_NE(recovery.message().find("stop was asked for"), std::string::npos) << recovery.message();
  EXPECT_EQ(take(), nullptr);
}

TEST_F(TransportTest, FromCollisionsAndUserStopsNobodyRecoversButAPerson) {
  auto a = client();
  auto message = skill_;
  message.mutable_recovery()->set_who(proto::RecoveryPolicy::ITSELF);
  const auto ends = [&] {
    auto skill = take();
    finish(std::move(skill), realtime::Ending::kRobotError);
    const auto result = a.receive().skill_result();
    EXPECT_FALSE(result.recovery().recovered());
    EXPECT_EQ(result.recovery().who(), proto::RecoveryPolicy::ASK);
    EXPECT_NE(result.message().find("then recover"), std::string::npos) << result.message();
    return result.recovery().obstacle();
  };
  proto::Request by_itself;
  by_itself.mutable_recover()->mutable_under()->set_who(proto::RecoveryPolicy::ITSELF);
  for (const auto error : {fci::Error::kJointReflex, fci::Error::kCartesianReflex, fci::Error::kSelfCollisionAvoidance}) {
    a.start(message);
    fail(error);
    EXPECT_EQ(ends(), proto::IN_REFLEX);
    EXPECT_FALSE(a.ask(by_itself).recovery().recovered()) << "nor does a program";
    EXPECT_FALSE(door_.recover);
    a.send(recover());
    get_well();
    answer({.recovered = true});
    EXPECT_TRUE(a.receive().recovery().recovered());
  }
  a.start(message);
  record_.phase = realtime::Phase::kError;
  record_.state.robot_mode = fci::RobotMode::kUserStopped;
  publish();
  EXPECT_EQ(ends(), proto::STOPPED_BY_USER);
  record_.state.robot_mode = fci::RobotMode::kIdle;  // it is released
  publish();
  const auto recovery = a.ask(by_itself).recovery();
  EXPECT_FALSE(recovery.recovered());
  EXPECT_EQ(recovery.obstacle(), proto::STOPPED_BY_USER);
  a.send(recover());
  get_well();
  answer({.recovered = true});
  EXPECT_TRUE(a.receive().recovery().recovered());
}

TEST_F(TransportTest, JointsOutsideTheirRangeAreMovedBackSlowly) {
  auto a = client();
  fail(fci::Error::kJointPositionLimits);
  const double q = record_.state.q[3] = fr3_limits().q_max[3] + 0.005;
  a.send(recover());
  get_well();
  answer({.recovered = true});
  std::unique_ptr<realtime::Skill> skill;
  while (!skill) skill = take();
  const realtime::Vector7 goal = skill->trajectory->goal().joint.q;
  EXPECT_LE(goal[3], fr3_limits().q_max[3]);
  EXPECT_GT(goal[3], q - 0.2);
  for (int i : {0, 1, 2, 4, 5, 6}) EXPECT_EQ(goal[i], record_.state.q[i]);
  EXPECT_LE(1.875 * (q - goal[3]) / skill->trajectory->duration(), 0.0501);
  finish(std::move(skill));
  const auto recovery = a.receive().recovery();
  EXPECT_TRUE(recovery.recovered());
  ASSERT_EQ(recovery.moved_back_size(), 1);
  EXPECT_EQ(recovery.moved_back(0), 4u);

  fail(fci::Error::kJointPositionLimits);
  a.send(recover());
  get_well();
  answer({.recovered = true});
  while (!skill) skill = take();
  a.send(recover());  // meanwhile
  a.state();
  EXPECT_EQ(door_.recover, 0u);
  finish(std::move(skill), realtime::Ending::kStopped);
  for (int n = 0; n < 2; ++n) EXPECT_EQ(a.receive().recovery().obstacle(), proto::OUTSIDE_JOINT_LIMITS);

  fail(fci::Error::kJointPositionLimits);
  a.send(recover());
  answer({.recovered = false, .status = fci::Status::kManualErrorRecoveryRequired, .robot_mode = fci::RobotMode::kReflex});
  const auto by_hand = a.receive().recovery();
  EXPECT_EQ(by_hand.obstacle(), proto::OUTSIDE_JOINT_LIMITS);
  EXPECT_NE(by_hand.message().find("joint 4 is 0.0050 rad outside its range"), std::string::npos) << by_hand.message();
}

class GatedRecoveryTest : public GatedTransportTest {
 protected:
  GatedRecoveryTest() : GatedTransportTest("MinJerkJoint") {}
};

TEST_F(GatedRecoveryTest, AnArmThatIsLostBeforeItWasMovedBackIsNotMovedLater) {
  auto a = client(), b = client();
  fail(fci::Error::kJointPositionLimits);
  record_.state.q[3] = fr3_limits().q_max[3] + 0.005;
  a.send(recover());
  get_well();
  answer({.recovered = true});
  gate.wait_for(1);
  transport_.disconnected("the robot is gone");
  for (int n = 0; n < 2; ++n) EXPECT_EQ(b.state().error().code(), proto::Error::NOT_READY);  // rounds, in which that is seen
  gate.open();
  const auto recovery = a.receive().recovery();
  EXPECT_FALSE(recovery.recovered());
  EXPECT_NE(recovery.message().find("the connection to the robot was lost"), std::string::npos) << recovery.message();
  connect();
  EXPECT_EQ(take(), nullptr);
}

TEST_F(TransportTest, ARobotThatIsLostWhileItRecoversLeavesNobodyWaiting) {
  auto a = client();
  auto message = skill_;
  message.mutable_recovery()->set_who(proto::RecoveryPolicy::ITSELF);
  a.start(message);
  auto skill = take();
  fail(fci::Error::kCommunicationConstraints);
  finish(std::move(skill), realtime::Ending::kRobotError);
  while (!door_.recover.load()) std::this_thread::sleep_for(100us);
  transport_.disconnected("the robot is gone");
  const auto result = a.receive().skill_result();
  EXPECT_EQ(result.ending(), proto::ROBOT_ERROR);
  EXPECT_EQ(result.recovery().obstacle(), proto::NOT_CONNECTED);
}

TEST_F(TransportTest, AChangeHasTheInputsOfThePartsThatStay) {
  auto a = client();
  proto::StreamJoint stream;
  stream.set_topic("goal");
  const auto id = a.start(skill_of(stream, proto::JointImpedance())).skill_started().skill_id();
  auto skill = take();
  record_.skill_id = id;
  publish();
  proto::Request request;
  request.mutable_change_skill()->set_skill_id(id);
  request.mutable_change_skill()->mutable_controller()->PackFrom(proto::JointImpedance());
  a.send(request);
  std::unique_ptr<realtime::Change> change;
  while (!change) change.reset(door_.change.take());
  ASSERT_EQ(change->inputs.size(), 1u);
  EXPECT_EQ(change->inputs[0], skill->inputs.at(0));
  change->done = true;
  door_.changed.push(change.release());
  EXPECT_TRUE(a.receive().has_done());
  finish(std::move(skill));
  EXPECT_TRUE(a.receive().has_skill_result());
}

TEST_F(TransportTest, AChangeThatComesTooLateLeavesNoListener) {
  auto a = client();
  const auto id = a.start(skill_).skill_started().skill_id();
  auto skill = take();
  record_.skill_id = id;
  publish();
  proto::Request request;
  request.mutable_change_skill()->set_skill_id(id);
  proto::StreamJoint stream;
  stream.set_topic("late");
  request.mutable_change_skill()->mutable_trajectory()->PackFrom(stream);
  a.send(request);
  std::unique_ptr<realtime::Change> change;
  while (!change) change.reset(door_.change.take());
  door_.changed.push(change.release());  // as the loop does whose skill has ended
  EXPECT_TRUE(a.receive().has_error());
  proto::Request topics;
  topics.mutable_list_topics();
  const auto told = a.ask(topics).topics();
  for (const auto& topic : told.topics()) EXPECT_EQ(topic.skills_size(), 0) << topic.topic();
  finish(std::move(skill));
  EXPECT_TRUE(a.receive().has_skill_result());
}

TEST_F(TransportTest, ALostRobotEndsWhatWaitsAndComesBack) {
  auto a = client();
  const auto started = a.start(skill_);
  transport_.disconnected("the robot is gone");
  const auto result = a.receive();
  EXPECT_EQ(result.request_id(), started.request_id());
  EXPECT_EQ(result.skill_result().ending(), proto::CONNECTION_LOST);
  const auto refused = a.start(skill_);
  EXPECT_EQ(refused.error().code(), proto::Error::NOT_READY);
  EXPECT_EQ(refused.error().message(), "the robot is gone");
  EXPECT_EQ(a.state().error().code(), proto::Error::NOT_READY);

  connect();
  EXPECT_EQ(take(), nullptr);  // nothing old waits for the new loop
  EXPECT_TRUE(a.start(skill_).has_skill_started());
}

TEST_F(TransportTest, GarbageIsCountedAndAnsweredWhereItCanBe) {
  auto a = client();
  std::mt19937 random(3);
  for (int n = 0; n < 500; ++n) {
    std::string bytes(random() % 200, '\0');
    for (char& byte : bytes) byte = static_cast<char>(random());
    a.send_bytes(bytes);
  }
  a.send_frames({"one", "two", "three"});
  a.send_frames({"", "x"});
  a.send_bytes("");

  // A request_id, then what ends in the middle.
  auto b = client();
  proto::Request request;
  request.set_request_id(4711);
  *request.mutable_start_skill()->mutable_skill() = skill_;
  const std::string whole = request.SerializeAsString();
  b.send_bytes(whole.substr(0, whole.size() / 2));
  auto reply = b.receive();
  EXPECT_EQ(reply.request_id(), 4711u);
  EXPECT_EQ(reply.error().code(), proto::Error::INVALID_ARGUMENT);

  // No call, and one that this server does not know.
  request.Clear();
  EXPECT_EQ(b.ask(request).error().code(), proto::Error::INVALID_ARGUMENT);
  request.GetReflection()->MutableUnknownFields(&request)->AddLengthDelimited(99, "");
  reply = b.ask(request);
  EXPECT_NE(reply.error().message().find("Request has a field number 99"), std::string::npos) << reply.error().message();
  request.Clear();
  request.mutable_list_arms();
  EXPECT_EQ(b.ask(request).error().code(), proto::Error::INVALID_ARGUMENT);

  EXPECT_TRUE(b.start(skill_).has_skill_started());
  EXPECT_GT(transport_.garbage(), 100u);
}

// Every prefix and every change of one byte of a good request leaves the server serving.
TEST_F(TransportTest, DamagedRequestsHurtNobody) {
  auto a = client(), b = client();
  proto::Request request;
  request.set_request_id(1);
  *request.mutable_start_skill()->mutable_skill() = skill_;
  const std::string whole = request.SerializeAsString();
  std::mt19937 random(5);
  for (std::size_t i = 0; i < whole.size(); ++i) {
    a.send_bytes(whole.substr(0, i));
    std::string changed = whole;
    changed[i] = static_cast<char>(random());
    a.send_bytes(changed);
  }
  EXPECT_TRUE(b.state().has_state());
}

TEST_F(TransportTest, AGripperThatIsNotThereIsSaidSo) {
  auto a = client();
  proto::Request request;
  request.mutable_gripper();
  EXPECT_EQ(a.ask(request).error().code(), proto::Error::INVALID_ARGUMENT);
  request.mutable_gripper()->mutable_homing();
  const auto reply = a.ask(request);
  EXPECT_EQ(reply.error().code(), proto::Error::NOT_READY);
  EXPECT_NE(reply.error().message().find("without a gripper"), std::string::npos) << reply.error().message();
}

// Listens to states as a client does.
class Subscriber {
 public:
  Subscriber(zmq::context_t& context, const std::string& endpoint, const std::string& topic)
      : topic_(topic + '\0'), socket_(context, zmq::socket_type::sub) {
    socket_.set(zmq::sockopt::linger, 0);
    socket_.set(zmq::sockopt::rcvtimeo, 20000);
    socket_.set(zmq::sockopt::subscribe, topic_);
    socket_.connect(endpoint);
  }
  // None where none comes; one that is there already, if asked for so.
  std::optional<proto::ArmState> next(zmq::recv_flags flags = zmq::recv_flags::none) {
    zmq::message_t message;
    if (!socket_.recv(message, flags)) return std::nullopt;
    proto::ArmState state;
    EXPECT_EQ(message.to_string_view().substr(0, topic_.size()), topic_);
    EXPECT_TRUE(state.ParseFromString(message.to_string().substr(topic_.size())));
    return state;
  }

 private:
  const std::string topic_;
  zmq::socket_t socket_;
};

TEST_F(TransportTest, StatesArePublishedToWhoListens) {
  Subscriber wrong(context_, publisher_.endpoint(), "10 robot.nothing");
  Subscriber all(context_, publisher_.endpoint(), "1");
  Subscriber some(context_, publisher_.endpoint(), "10 robot.q,cycles");
  std::optional<proto::ArmState> of_all, of_some;
  // Until the subscriptions have arrived; at the loop's pace, with which the publisher keeps up.
  while (!of_all || !of_some) {
    publish();
    std::this_thread::sleep_for(1ms);
    if (!of_all) of_all = all.next(zmq::recv_flags::dontwait);
    if (!of_some) of_some = some.next(zmq::recv_flags::dontwait);
  }
  for (int n = 1; n <= 50; ++n) publish();
  for (auto expected = of_all->cycles() + 1; expected <= record_.cycles; ++expected) {
    ASSERT_TRUE(of_all = all.next());
    EXPECT_EQ(of_all->cycles(), expected);
    EXPECT_EQ(of_all->robot().q(3), models::kHome[3]);
    EXPECT_EQ(of_all->robot().tau_j_size(), 7);
  }
  for (auto expected = of_some->cycles() + 10; expected <= record_.cycles; expected += 10) {
    ASSERT_TRUE(of_some = some.next());
    EXPECT_EQ(of_some->cycles(), expected);
    EXPECT_EQ(of_some->robot().q(3), models::kHome[3]);
    EXPECT_EQ(of_some->robot().tau_j_size(), 0);
    EXPECT_FALSE(of_some->has_phase());
  }
  EXPECT_FALSE(some.next(zmq::recv_flags::dontwait));
  EXPECT_FALSE(wrong.next(zmq::recv_flags::dontwait));
}

TEST_F(TransportTest, WhoSubscribesToTooMuchIsCutOffAndNobodyElse) {
  Subscriber honest(context_, publisher_.endpoint(), "1 cycles");
  std::optional<proto::ArmState> state;
  while (!(state = honest.next(zmq::recv_flags::dontwait))) {
    publish();
    std::this_thread::sleep_for(1ms);
  }
  for (const std::size_t length : {20u, 100'000u}) {  // many, and long ones
    zmq::socket_t greedy(context_, zmq::socket_type::sub);
    greedy.set(zmq::sockopt::linger, 0);
    greedy.set(zmq::sockopt::reconnect_ivl, -1);
    const std::string events = "inproc://greedy " + std::to_string(length);
    ASSERT_EQ(zmq_socket_monitor(greedy.handle(), events.c_str(), ZMQ_EVENT_DISCONNECTED), 0);
    zmq::socket_t monitor(context_, zmq::socket_type::pair);
    monitor.set(zmq::sockopt::rcvtimeo, 20000);
    monitor.connect(events);
    std::mt19937 random(7);
    for (int n = 0; n < 1000; ++n) {
      std::string topic(length, '\0');
      for (char& byte : topic) byte = static_cast<char>('a' + random() % 26);
      greedy.set(zmq::sockopt::subscribe, topic);
      if (length > 1000) break;
    }
    greedy.connect(publisher_.endpoint());
    zmq::message_t event;
    EXPECT_TRUE(monitor.recv(event)) << "it has its connection still";
    zmq_socket_monitor(greedy.handle(), nullptr, 0);
  }
  const auto last = record_.cycles;
  publish();
  while (state && state->cycles() <= last) state = honest.next();
  EXPECT_TRUE(state);
  EXPECT_TRUE(client().state().has_state());
}

TEST_F(TransportTest, WhatIsNoSubscriptionIsNotTakenForOne) {
  Subscriber honest(context_, publisher_.endpoint(), "1 cycles");
  publish_until_heard(honest);
  zmq::socket_t odd(context_, zmq::socket_type::xsub);
  odd.set(zmq::sockopt::linger, 0);
  odd.connect(publisher_.endpoint());
  for (int n = 2; n < 200; ++n) odd.send(zmq::buffer("\x02" + std::to_string(n)), zmq::send_flags::none);
  Subscriber other(context_, publisher_.endpoint(), "3 cycles");  // there is room for it still
  publish_until_heard(other);
  EXPECT_TRUE(honest.next());
}

// A subscriber that speaks ZMTP 3.0 byte by byte, as no library lets one cancel what was not subscribed to.
class RawSubscriber {
 public:
  explicit RawSubscriber(const std::string& endpoint) : fd_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(port_of(endpoint));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(fd_, reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
    std::string greeting(64, '\0');
    greeting[0] = '\xff';
    greeting[9] = '\x7f';
    greeting[10] = 3;
    greeting.replace(12, 4, "NULL");
    const std::string ready = std::string("\x05READY\x0bSocket-Type\0\0\0\x03SUB", 25);
    send(greeting + std::string{4, static_cast<char>(ready.size())} + ready);
    // The library ends a connection over which a message comes before it is ready itself.
    std::string answer;
    char byte;
    while (!answer.ends_with("XPUB") && ::recv(fd_, &byte, 1, 0) == 1) answer += byte;
  }
  ~RawSubscriber() { ::close(fd_); }

  // One message of one frame.
  void send_message(const std::string& body) { send(std::string{0, static_cast<char>(body.size())} + body); }
  // Until the other side has ended the connection.
  void wait_for_end() {
    char bytes[4096];
    while (::recv(fd_, bytes, sizeof bytes, 0) > 0) {
    }
  }

 private:
  void send(const std::string& bytes) { EXPECT_EQ(::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL), std::ssize(bytes)); }

  int fd_;
};

TEST_F(TransportTest, WhoCancelsWhatOthersListenToSilencesNobody) {
  Subscriber honest(context_, publisher_.endpoint(), "1 cycles");
  const auto hears = [&] {
    while (honest.next(zmq::recv_flags::dontwait)) {
    }
    publish();
    return honest.next().has_value();
  };
  publish_until_heard(honest);
  const std::string topic = std::string("1 cycles") + '\0';
  for (const std::string& message : {'\0' + topic, '\1' + topic + '\1', '\1' + topic}) {
    RawSubscriber raw(publisher_.endpoint());
    raw.send_message(message);
    if (message[0] == 1) raw.send_message(message);  // twice the same
    raw.wait_for_end();
    EXPECT_TRUE(hears());
  }
  // Who cancels its own goes, and comes back.
  {
    RawSubscriber raw(publisher_.endpoint());
    for (int i = 0; i < 3; ++i) {
      raw.send_message('\1' + topic);
      raw.send_message('\0' + topic);
    }
    raw.send_message('\0' + topic);
    raw.wait_for_end();
  }
  EXPECT_TRUE(hears());
  // What nobody listens to any longer leaves its room to others.
  {
    RawSubscriber many(publisher_.endpoint());
    for (int n = 1; n <= 200; ++n) many.send_message('\1' + std::to_string(n) + " cycles");
    many.send_message('\1' + std::string("200 cycles"));  // twice the same: then all of it was read
    many.wait_for_end();
  }
  bool heard = false;
  for (int i = 0; i < 2000 && !heard; ++i) {
    Subscriber another(context_, publisher_.endpoint(), "1 phase");
    for (int n = 0; n < 20; ++n) {
      publish();
      std::this_thread::sleep_for(1ms);
    }
    heard = another.next(zmq::recv_flags::dontwait).has_value();
  }
  EXPECT_TRUE(heard);
}

TEST_F(TransportTest, WhatOfTheRobotIsNotTakenIsPublished) {
  auto a = client();
  EXPECT_FALSE(a.state().state().has_not_taken());
  const auto counters = std::make_shared<robot::FciDriver::Counters>();
  counters->wrong_size = 3;
  counters->bad_values = 5;
  publisher_.count(counters);
  const auto not_taken = a.state().state().not_taken();
  EXPECT_EQ(not_taken.wrong_size(), 3u);
  EXPECT_EQ(not_taken.bad_values(), 5u);
  EXPECT_EQ(not_taken.foreign(), 0u);
}

TEST(ConnectionLimit, EndsThoseThatAreTooMany) {
  zmq::context_t context;
  zmq::socket_t socket(context, zmq::socket_type::router);
  socket.bind("tcp://127.0.0.1:*");
  const std::string endpoint = socket.get(zmq::sockopt::last_endpoint);
  ConnectionLimit limit(context, socket, 3);
  const auto connect = [&] {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in to{.sin_family = AF_INET, .sin_port = htons(port_of(endpoint)), .sin_addr = {htonl(INADDR_LOOPBACK)}, .sin_zero = {}};
    EXPECT_EQ(::connect(fd, reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
    return fd;
  };
  // The greeting of the library, and then the end where it was ended.
  const auto ended = [&](int fd) {
    char bytes[64];
    for (ssize_t size; (size = ::recv(fd, bytes, sizeof bytes, MSG_DONTWAIT)) != 0;) {
      if (size < 0 && errno != EAGAIN) return true;
      if (size < 0) return false;
    }
    return true;
  };
  std::vector<int> fds;
  for (int i = 0; i < 10; ++i) fds.push_back(connect());
  const auto left = [&] { return std::count_if(fds.begin(), fds.end(), [&](int fd) { return !ended(fd); }); };
  while (left() > 3) limit.look();
  EXPECT_EQ(left(), 3);
  // Where one goes, another may come.
  for (const int fd : fds) ::close(fd);
  fds.clear();
  Client client(context, endpoint);
  client.send_bytes("a word");
  zmq::message_t identity;
  while (!socket.recv(identity, zmq::recv_flags::dontwait)) {
    limit.look();
    std::this_thread::sleep_for(1ms);
  }
}

}  // namespace
}  // namespace server
