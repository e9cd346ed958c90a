#include <gtest/gtest.h>

#include <set>

#include "server/convert.hpp"
#include "server/registry.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;

// Gives every number of a state a value of its own.
class Fill : public fci::Visitor<Fill> {
 public:
  Fill() : Visitor(fci::kNewestVersion) {}
  template <class Wire, class T>
  void field(const char* name, T& value) {
    names.insert(name);
    if constexpr (std::is_same_v<Wire, float> || std::is_same_v<Wire, double>) {
      if constexpr (fci::detail::Elements<T>::kCount == 1) {
        value = next_ += 0.25;
      } else {
        for (auto& element : value) element = next_ += 0.25;
      }
    }
  }
  std::set<std::string> names;

 private:
  double next_ = 0;
};

// Compares them with the message's field of the same name.
class Compare : public fci::Visitor<Compare> {
 public:
  explicit Compare(const proto::RobotState& message) : Visitor(fci::kNewestVersion), message_(message) {}
  template <class Wire, class T>
  void field(const char* name, const T& value) {
    const auto* field = message_.GetDescriptor()->FindFieldByName(name);
    ASSERT_NE(field, nullptr) << name;
    if constexpr (std::is_same_v<Wire, float> || std::is_same_v<Wire, double>) {
      const auto* get = message_.GetReflection();
      if constexpr (fci::detail::Elements<T>::kCount == 1) {
        EXPECT_EQ(get->GetDouble(message_, field), value) << name;
      } else {
        ASSERT_EQ(get->FieldSize(message_, field), static_cast<int>(value.size())) << name;
        for (std::size_t i = 0; i < value.size(); ++i) {
          EXPECT_EQ(get->GetRepeatedDouble(message_, field, i), value[i]) << name << "[" << i << "]";
        }
      }
    }
  }

 private:
  const proto::RobotState& message_;
};

TEST(Convert, TheStateOfTheRobotIsTheSameFieldByField) {
  realtime::Record record;
  Fill fill;
  walk(fill, record.state);
  record.state.message_id = 123456789;
  record.state.errors[6] = record.state.reflex_reason[7] = true;
  record.state.robot_mode = fci::RobotMode::kReflex;
  record.state.motion_generator_mode = fci::MotionGeneratorMode::kCartesianVelocity;
  record.state.controller_mode = fci::ControllerMode::kExternal;

  proto::ArmState message;
  convert(record, message);
  Compare compare(message.robot());
  walk(compare, std::as_const(record.state));
  EXPECT_EQ(message.robot().message_id(), 123456789u);
  ASSERT_EQ(message.robot().errors_size(), 1);
  EXPECT_EQ(message.robot().errors(0), "joint_reflex");
  ASSERT_EQ(message.robot().reflex_reason_size(), 1);
  EXPECT_EQ(message.robot().reflex_reason(0), "cartesian_reflex");
  EXPECT_EQ(message.robot().robot_mode(), proto::REFLEX);
  EXPECT_EQ(message.robot().motion_generator_mode(), 4u);
  EXPECT_EQ(message.robot().controller_mode(), 2u);
  // And the message has nothing that the state lacks.
  for (int i = 0; i < message.robot().GetDescriptor()->field_count(); ++i) {
    EXPECT_TRUE(fill.names.contains(message.robot().GetDescriptor()->field(i)->name()));
  }
}

TEST(Convert, TheReferenceIsThereWhileSomethingIsCommanded) {
  realtime::Record record;
  record.reference.joint.q << 1, 2, 3, 4, 5, 6, 7;
  proto::ArmState message;
  convert(record, message);
  EXPECT_EQ(message.q_ref_size(), 0);
  EXPECT_EQ(message.dq_ref_size(), 0);

  record.reference.joint.dq[3] = 0.5;
  record.reference.torque[6] = -2;
  record.command.message_id = 1;
  convert(record, message);
  ASSERT_EQ(message.q_ref_size(), 7);
  EXPECT_EQ(message.q_ref(6), 7);
  EXPECT_EQ(message.o_t_ee_ref_size(), 0);
  ASSERT_EQ(message.dq_ref_size(), 7);
  EXPECT_EQ(message.dq_ref(3), 0.5);
  ASSERT_EQ(message.tau_ref_size(), 7);
  EXPECT_EQ(message.tau_ref(6), -2);
  EXPECT_EQ(message.o_f_ee_ref_size(), 0);

  record.reference.torque.setZero();
  record.reference.wrench[2] = -10;
  record.reference.cartesian.velocity[5] = 0.25;
  record.reference.motion = realtime::Channels::kPose;
  record.reference.cartesian.position << 0.1, 0.2, 0.3;
  convert(record, message);
  EXPECT_EQ(message.q_ref_size(), 0);
  EXPECT_EQ(message.dq_ref_size(), 0);
  EXPECT_EQ(message.tau_ref_size(), 0);
  ASSERT_EQ(message.o_f_ee_ref_size(), 6);
  EXPECT_EQ(message.o_f_ee_ref(2), -10);
  ASSERT_EQ(message.o_dp_ee_ref_size(), 6);
  EXPECT_EQ(message.o_dp_ee_ref(5), 0.25);
  ASSERT_EQ(message.o_t_ee_ref_size(), 16);
  EXPECT_EQ(message.o_t_ee_ref(0), 1);
  EXPECT_EQ(message.o_t_ee_ref(13), 0.2);
}

TEST(Convert, AResultSaysWhatHappenedAndWhatToDo) {
  const auto text = [](const realtime::SkillResult& result) {
    proto::SkillResult message;
    convert(result, message);
    return message.message();
  };
  EXPECT_EQ(text({.ending = realtime::Ending::kTerminated}), "");
  EXPECT_EQ(text({.ending = realtime::Ending::kStopped}), "");
  realtime::SkillResult error{.ending = realtime::Ending::kRobotError, .time = 1.25};
  EXPECT_NE(text(error).find("names no error"), std::string::npos);
  realtime::SkillResult stopped{.ending = realtime::Ending::kRobotError, .time = 1.25, .robot_mode = fci::RobotMode::kUserStopped};
  EXPECT_EQ(text(stopped), "the user stop was pressed after 1.250 s");
  error.errors[6] = true;
  EXPECT_NE(text(error).find("after 1.250 s with joint_reflex"), std::string::npos) << text(error);
  realtime::SkillResult refused{.ending = realtime::Ending::kRefused, .status = fci::Status::kInvalidArgument};
  refused.refused = fci::Command::kSetJointImpedance;
  EXPECT_NE(text(refused).find("SetJointImpedance: invalid argument"), std::string::npos) << text(refused);

  using Why = realtime::PartFault::Why;
  const std::uint16_t number = number_of("CartesianImpedance");
  EXPECT_GT(number, 0);
  const auto fault = [&](Why why, std::uint16_t part) {
    return text({.ending = realtime::Ending::kComponentFault, .time = 0.5, .fault = {why, part, 4'250'000}});
  };
  EXPECT_TRUE(fault(Why::kTooLong, number).starts_with("the controller CartesianImpedance takes too long for the 1 kHz loop: "
                                                       "the last step took 4.25 ms, and should take 0.3 ms at most"))
      << fault(Why::kTooLong, number);
  EXPECT_TRUE(fault(Why::kAllocates, number_of("Time")).starts_with("the termination Time took memory from the heap"));
  EXPECT_TRUE(fault(Why::kNotFinite, number_of("StayPose")).starts_with("the trajectory StayPose gave a value that is not"));
  EXPECT_TRUE(fault(Why::kNotFinite, 0).starts_with("a part gave a value")) << "of a skill that has no numbers";
  error.fault = {Why::kTooLong, number, 30'000'000};
  EXPECT_EQ(text(error).find("One step of"), std::string::npos) << "which is not late";
  error.errors[static_cast<std::size_t>(fci::Error::kCommunicationConstraints)] = true;
  EXPECT_NE(text(error).find("One step of the controller CartesianImpedance took 30 ms"), std::string::npos) << text(error);
  error.lost_states = 3;
  error.lost_commands = 21;
  EXPECT_NE(text(error).find("(3 states were lost, and of the last 100 commands 21)"), std::string::npos) << text(error);
}

TEST(Convert, WhatTheArmWaitsForIsNoOlderReflex) {
  fci::RobotState state;
  state.reflex_reason[6] = true;  // of the last reflex, which the robot keeps
  state.robot_mode = fci::RobotMode::kUserStopped;
  EXPECT_EQ(errors_of(state), "user stop is pressed");
  state.robot_mode = fci::RobotMode::kGuiding;
  EXPECT_EQ(errors_of(state), "the arm is being guided by hand");
  state.robot_mode = fci::RobotMode::kReflex;
  EXPECT_EQ(errors_of(state), "joint_reflex");
  state.errors[7] = true;
  EXPECT_EQ(errors_of(state), "cartesian_reflex");
}

}  // namespace
}  // namespace server
