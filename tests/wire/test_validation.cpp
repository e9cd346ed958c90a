#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "frankapy/proto/controllers.pb.h"
#include "frankapy/proto/rules.pb.h"
#include "frankapy/proto/service.pb.h"
#include "frankapy/proto/terminations.pb.h"
#include "frankapy/proto/trajectories.pb.h"
#include "wire/proto/validation.hpp"

namespace wire {
namespace {

namespace proto = frankapy::proto;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::string error_of(google::protobuf::Message&& message) {
  try {
    validate(message);
  } catch (const Invalid& invalid) {
    return invalid.what();
  }
  return "no error";
}

proto::MinJerkJoint joint_motion() {
  proto::MinJerkJoint message;
  for (int i = 0; i < 7; ++i) message.add_q(0.1 * i);
  return message;
}

TEST(Validation, NamesMessageFieldElementValueAndBound) {
  EXPECT_EQ(error_of(joint_motion()), "no error");

  EXPECT_EQ(error_of(proto::MinJerkJoint()), "MinJerkJoint.q has 0 elements: expected 7 (rad)");

  auto message = joint_motion();
  message.add_q(0);
  EXPECT_EQ(error_of(std::move(message)), "MinJerkJoint.q has 8 elements: expected 7 (rad)");

  message = joint_motion();
  message.set_q(3, kNaN);
  EXPECT_EQ(error_of(std::move(message)), "MinJerkJoint.q[3] is nan: expected a finite number (rad)");

  message = joint_motion();
  message.set_duration(std::numeric_limits<double>::infinity());
  EXPECT_EQ(error_of(std::move(message)), "MinJerkJoint.duration is inf: expected a finite number (s)");

  message = joint_motion();
  message.set_duration(-2);
  EXPECT_EQ(error_of(std::move(message)), "MinJerkJoint.duration is -2 s: expected 0.001 to 3600 s");

  EXPECT_EQ(error_of(proto::GripperCommand::Move()), "Move.width is missing: expected a number (m)");
}

TEST(Validation, ARotationIsAUnitQuaternion) {
  proto::MinJerkPose message;
  for (double x : {0.5, 0.0, 0.5}) message.add_position(x);
  for (double x : {1.0, 1.0, 0.0, 0.0}) message.add_quaternion(x);
  EXPECT_EQ(error_of(std::move(message)),
            "MinJerkPose.quaternion has the norm 1.41421: expected a unit quaternion (w,x,y,z), 1 within 0.001");
}

TEST(Validation, FillsInWhatIsNotGiven) {
  proto::JointImpedance message;
  validate(message);
  ASSERT_EQ(message.stiffness_size(), 7);
  EXPECT_EQ(message.stiffness(0), 600);
  EXPECT_EQ(message.damping(6), 15);
}

TEST(Validation, LooksIntoMessagesInMessages) {
  proto::Request request;
  request.mutable_gripper()->mutable_grasp()->set_width(kNaN);
  EXPECT_EQ(error_of(std::move(request)), "Grasp.width is nan: expected a finite number (m)");
}

TEST(Validation, RefusesWhatANewerClientSends) {
  auto message = joint_motion();
  message.GetReflection()->MutableUnknownFields(&message)->AddVarint(99, 1);
  const std::string text = error_of(std::move(message));
  EXPECT_TRUE(text.starts_with("MinJerkJoint has a field number 99 that this program does not know; known are: q, duration"))
      << text;

  // An enum value that this server lacks ends up among the unknown fields.
  proto::RelativeMinJerkPose pose;
  for (int i = 0; i < 3; ++i) pose.add_translation(0);
  std::string bytes = pose.SerializeAsString();
  bytes += static_cast<char>(proto::RelativeMinJerkPose::kFrameFieldNumber << 3);
  bytes += '\x37';
  ASSERT_TRUE(pose.ParseFromString(bytes));
  EXPECT_TRUE(error_of(std::move(pose)).starts_with("RelativeMinJerkPose.frame has a value that this program does not know"));
}

TEST(Validation, TextIsUtf8) {
  using namespace std::string_literals;
  for (const auto& bad : {"\xff"s, "\xc3"s, "\xc0\x80"s, "\xed\xa0\x80"s, "\xf5\x80\x80\x80"s, "a\x80"s, "a\0"s}) {
    proto::Skill skill;
    skill.set_description(bad);
    EXPECT_EQ(error_of(std::move(skill)), "Skill.description is not UTF-8 text, or has NUL in it");
  }
  proto::Skill skill;
  skill.set_description("Ärmel, 腕, 🦾");
  EXPECT_EQ(error_of(std::move(skill)), "no error");
}

TEST(Validation, TablesHaveWholeRowsAndNotTooMany) {
  proto::JointWaypoints joints;
  EXPECT_EQ(error_of(proto::JointWaypoints(joints)), "JointWaypoints.q has 0 elements: expected rows of 7 (rad)");
  for (int i = 0; i < 15; ++i) joints.add_q(0);
  EXPECT_EQ(error_of(proto::JointWaypoints(joints)), "JointWaypoints.q has 15 elements: expected rows of 7 (rad)");
  joints.mutable_q()->Truncate(14);
  EXPECT_EQ(error_of(proto::JointWaypoints(joints)), "no error");
  for (int i = 0; i < 7 * 1000; ++i) joints.add_q(0);
  EXPECT_EQ(error_of(proto::JointWaypoints(joints)), "JointWaypoints.q has 1002 rows: expected at most 1000");

  proto::PoseSamples poses;
  for (double each : {0.4, 0.0, 0.4, 0.4, 0.0, 0.4}) poses.add_position(each);
  for (double each : {1.0, 0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0}) poses.add_quaternion(each);
  EXPECT_EQ(error_of(proto::PoseSamples(poses)),
            "row 1 of PoseSamples.quaternion has the norm 0.9: expected a unit quaternion (w,x,y,z), 1 within 0.001");
  poses.set_quaternion(4, -1);
  EXPECT_EQ(error_of(proto::PoseSamples(poses)), "no error");

  proto::JointDmp dmp;
  dmp.set_tau(1);
  dmp.set_alpha(1);
  dmp.set_beta(1);
  EXPECT_EQ(error_of(proto::JointDmp(dmp)), "JointDmp.mu has 0 elements: expected at least 1");
}

// Whatever a rule forbids is refused, in every field of every kind.
TEST(Validation, HoldsForEveryFieldOfEveryKind) {
  int checked = 0;
  for (const auto* file : {proto::MinJerkJoint::descriptor()->file(), proto::JointImpedance::descriptor()->file(),
                           proto::Time::descriptor()->file()}) {
    for (int i = 0; i < file->message_type_count(); ++i) {
      const auto* type = file->message_type(i);
      for (int k = 0; k < type->field_count(); ++k) {
        const auto* field = type->field(k);
        if (field->cpp_type() != google::protobuf::FieldDescriptor::CPPTYPE_DOUBLE) continue;
        const auto& rule = field->options().GetExtension(proto::rule);
        const auto refuses = [&](double value) {
          std::unique_ptr<google::protobuf::Message> message(
              google::protobuf::MessageFactory::generated_factory()->GetPrototype(type)->New());
          const auto* reflection = message->GetReflection();
          // The other fields are given, so that it is this one that is refused.
          for (int n = 0; n < type->field_count(); ++n) {
            const auto& other = type->field(n)->options().GetExtension(proto::rule);
            if (type->field(n)->type() == google::protobuf::FieldDescriptor::TYPE_STRING) {
              reflection->SetString(message.get(), type->field(n), "name");
              continue;
            }
            if (!type->field(n)->is_repeated() && other.required()) {
              reflection->SetDouble(message.get(), type->field(n), other.min());
            }
            const unsigned size = std::max({1u, other.size(), other.row()});
            for (unsigned m = 0; type->field(n)->is_repeated() && m < size; ++m) {
              reflection->AddDouble(message.get(), type->field(n), other.unit_norm() && m > 0 ? 0 : 1);
            }
          }
          if (field->is_repeated()) {
            reflection->SetRepeatedDouble(message.get(), field, reflection->FieldSize(*message, field) - 1, value);
          } else {
            reflection->SetDouble(message.get(), field, value);
          }
          const std::string text = error_of(std::move(*message));
          return text.find(type->name() + "." + field->name()) < 8;  // behind the number of a row
        };
        EXPECT_TRUE(refuses(kNaN)) << field->full_name();
        EXPECT_TRUE(refuses(std::numeric_limits<double>::infinity())) << field->full_name();
        if (rule.has_min()) {
          EXPECT_TRUE(refuses(rule.min() - 1e-3)) << field->full_name();
        }
        if (rule.has_max()) {
          EXPECT_TRUE(refuses(rule.max() * 1.001)) << field->full_name();
        }
        ++checked;
      }
    }
  }
  EXPECT_GT(checked, 15);
}

}  // namespace
}  // namespace wire
