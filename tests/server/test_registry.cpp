#include <gtest/gtest.h>

#include <set>

#include "frankapy/proto/controllers.pb.h"
#include "frankapy/proto/endings.pb.h"
#include "frankapy/proto/terminations.pb.h"
#include "frankapy/proto/trajectories.pb.h"
#include "server/refused.hpp"
#include "server/registry.hpp"

namespace server {
namespace {

realtime::Arm arm() {
  static realtime::Model model(models::urdf(models::arm("fr3"), 10));
  return {models::limits(models::arm("fr3"), 10), model, realtime::Vector7::Map(models::kHome.data())};
}

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
  EXPECT_EQ(set_of(ending_kinds()), messages_of(proto::BackOff::descriptor()));
}

TEST(Registry, AnUnknownKindIsRefusedWithThoseKnown) {
  google::protobuf::Any any;
  any.set_type_url("type.googleapis.com/frankapy.proto.Waltz");
  try {
    make_trajectory(any, arm());
    FAIL() << "made";
  } catch (const Refused& refused) {
    EXPECT_EQ(refused.code, proto::Error::INVALID_ARGUMENT);
    EXPECT_TRUE(std::string(refused.what())
                    .starts_with("Waltz is no trajectory that this server knows; known are MinJerkJoint, "))
        << refused.what();
  }
  // A kind of another sort is none either.
  any.PackFrom(proto::JointImpedance());
  EXPECT_THROW(make_trajectory(any, arm()), Refused);
  EXPECT_NO_THROW(make_controller(any, arm()));
  EXPECT_THROW(make_controller({}, arm()), Refused);
}

TEST(Registry, BytesThatAreNoMessageAreRefused) {
  google::protobuf::Any any;
  any.PackFrom(proto::JointImpedance());
  any.set_value("\x0a\xff\xff\xff");
  try {
    make_controller(any, arm());
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
  EXPECT_THROW(make_controller(any, arm()), Refused);

  any.PackFrom(proto::Time());  // neither of its two times
  EXPECT_THROW(make_termination(any, arm()), Refused);
}

TEST(Registry, NumbersAreThePlacesOfTheTitles) {
  const auto titles = titles_of_kinds();
  EXPECT_EQ(titles.size(), trajectory_kinds().size() + controller_kinds().size() + termination_kinds().size());
  for (const auto& [role, kinds] : {std::pair{"trajectory ", trajectory_kinds()}, std::pair{"controller ", controller_kinds()},
                                    std::pair{"termination ", termination_kinds()}}) {
    for (const auto& kind : kinds) EXPECT_EQ(titles.at(number_of(kind) - 1), role + kind);
  }
  EXPECT_EQ(number_of("Waltz"), 0);
  EXPECT_EQ(number_of("elsewhere.Time"), 0);
}

}  // namespace
}  // namespace server
