#include <gtest/gtest.h>

#include <set>

#include "frankapy/proto/controllers.pb.h"
#include "frankapy/proto/terminations.pb.h"
#include "frankapy/proto/trajectories.pb.h"
#include "server/refused.hpp"
#include "server/registry.hpp"

namespace server {
namespace {

const models::Limits& limits() { return models::limits(models::arm("fr3"), 10); }

std::set<std::string> messages_of(const google::protobuf::Descriptor* one) {
  std::set<std::string> names;
  for (int i = 0; i < one->file()->message_type_count(); ++i) names.insert(one->file()->message_type(i)->name());
  return names;
}

std::set<std::string> set_of(const std::vector<std::string>& names) { return {names.begin(), names.end()}; }

TEST(Registry, HasALineForEveryMessageAndAMessageForEveryLine) {
  EXPECT_EQ(set_of(trajectory_kinds()), messages_of(proto::MinJerkJoint::descriptor()));
  EXPECT_EQ(set_of(controller_kinds()), messages_of(proto::JointImpedance::descriptor()));
  EXPECT_EQ(set_of(termination_kinds()), messages_of(proto::Time::descriptor()));
}

TEST(Registry, AnUnknownKindIsRefusedWithThoseKnown) {
  google::protobuf::Any any;
  any.set_type_url("type.googleapis.com/frankapy.proto.Waltz");
  try {
    make_trajectory(any, limits());
    FAIL() << "made";
  } catch (const Refused& refused) {
    EXPECT_EQ(refused.code, proto::Error::INVALID_ARGUMENT);
    EXPECT_TRUE(std::string(refused.what())
                    .starts_with("Waltz is no trajectory that this server knows; known are MinJerkJoint, "))
        << refused.what();
  }
  // A kind of another sort is none either.
  any.PackFrom(proto::JointImpedance());
  EXPECT_THROW(make_trajectory(any, limits()), Refused);
  EXPECT_NO_THROW(make_controller(any, limits()));
  EXPECT_THROW(make_controller({}, limits()), Refused);
}

TEST(Registry, BytesThatAreNoMessageAreRefused) {
  google::protobuf::Any any;
  any.PackFrom(proto::JointImpedance());
  any.set_value("\x0a\xff\xff\xff");
  try {
    make_controller(any, limits());
    FAIL() << "made";
  } catch (const Refused& refused) {
    EXPECT_STREQ(refused.what(), "4 bytes that are no JointImpedance");
  }
}

TEST(Registry, AComponentsOwnChecksAreRefusals) {
  proto::InternalImpedance both;
  for (int i = 0; i < 7; ++i) both.add_k_theta(1000);
  for (int i = 0; i < 6; ++i) both.add_k_x(100);
  google::protobuf::Any any;
  any.PackFrom(both);
  EXPECT_THROW(make_controller(any, limits()), Refused);

  any.PackFrom(proto::Time());  // neither of its two times
  EXPECT_THROW(make_termination(any, limits()), Refused);
}

}  // namespace
}  // namespace server
