#include <gtest/gtest.h>

#include <regex>

#include "server/arm_model.hpp"

namespace server {
namespace {

std::string renamed(const std::string& urdf, const std::string& name) {
  return std::regex_replace(urdf, std::regex("<robot name=\"[^\"]*\""), "<robot name=\"" + name + "\"");
}

TEST(ArmModel, OlderRobotsAreKnownByTheirProtocol) {
  EXPECT_EQ(choose_model(5, "", "auto").arm->name, "fer");
  EXPECT_EQ(choose_model(6, "", "auto").arm->name, "fr3");
  EXPECT_EQ(choose_model(7, "", "auto").warning, "");
}

TEST(ArmModel, NewerRobotsSayWhatTheyAre) {
  for (const auto& arm : models::arms()) {
    const std::string urdf = models::urdf(arm, 10);
    const ArmModel chosen = choose_model(10, urdf, "auto");
    EXPECT_EQ(chosen.arm->name, arm.name);
    EXPECT_TRUE(chosen.urdf == urdf);
    EXPECT_EQ(chosen.warning, "");
    // Under a name of its own it is known by its inertia.
    const std::string other = renamed(urdf, "r2d2");
    ASSERT_NE(other, urdf);
    EXPECT_EQ(choose_model(10, other, "auto").arm->name, arm.name);
  }
}

// As clients compute it from the description: sqrt(2 deceleration distance) - offset, between zero and the greatest.
TEST(ArmModel, NewerRobotsDescribeAJointThatMayMove) {
  for (const auto& arm : models::arms()) {
    const std::string urdf = models::urdf(arm, 10);
    const std::regex limits("velocity_offset=\"([^\"]*)\" deceleration_limit=\"([^\"]*)\"");
    std::size_t joints = 0;
    for (std::sregex_iterator found(urdf.begin(), urdf.end(), limits), end; found != end; ++found, ++joints) {
      EXPECT_GT(std::sqrt(2 * std::stod((*found)[2])) - std::stod((*found)[1]), 1) << arm.name << " one rad from its end";
    }
    EXPECT_EQ(joints, 7u);
  }
}

TEST(ArmModel, ADescriptionThatCannotBeUsedIsReplacedAndToldOf) {
  const std::string urdf = models::urdf(models::arm("fr3"), 10);
  const std::string massless = std::regex_replace(urdf, std::regex("<inertial>[\\s\\S]*?</inertial>"), "");
  for (const std::string& bad : {std::string(), std::string("<robot"), massless}) {
    const ArmModel chosen = choose_model(10, bad, "auto");
    EXPECT_EQ(chosen.arm->name, "fr3");
    EXPECT_TRUE(chosen.urdf == urdf);
    EXPECT_NE(chosen.warning, "");
  }
}

TEST(ArmModel, TheConfigurationSaysWhatTheRobotDoesNot) {
  const std::string urdf = models::urdf(models::arm("fr3"), 10);
  EXPECT_EQ(choose_model(10, urdf, "fr3").warning, "");
  // Protocol 6 says that it is an FR3, not which.
  EXPECT_EQ(choose_model(6, "", "fr3v2").arm->name, "fr3v2");
  EXPECT_EQ(choose_model(6, "", "fr3v2").warning, "");
  // A robot under a name of its own is known by its inertia, which may be wrong.
  const ArmModel other = choose_model(10, renamed(urdf, "r2d2"), "fr3v2");
  EXPECT_EQ(other.arm->name, "fr3v2");
  EXPECT_TRUE(other.urdf == models::urdf(models::arm("fr3v2"), 10));
  EXPECT_NE(other.warning.find("fr3v2"), std::string::npos);
}

TEST(ArmModel, AConfigurationThatTheRobotContradictsIsRefused) {
  const auto refusal = [](fci::Version version, const std::string& urdf, const std::string& configured) -> std::string {
    try {
      choose_model(version, urdf, configured);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "taken";
  };
  const std::string fr3 = models::urdf(models::arm("fr3"), 10);
  for (const std::string& text : {refusal(5, "", "fr3"), refusal(5, "", "fr3v2"), refusal(6, "", "fer"), refusal(10, "", "fer"),
                                  refusal(10, fr3, "fer"), refusal(10, fr3, "fr3v2"), refusal(10, renamed(fr3, "r2d2"), "fer"),
                                  refusal(8, models::urdf(models::arm("fr3v2"), 8), "fr3")}) {
    EXPECT_NE(text.find("limits and masses of another arm would apply. Set model = \"auto\""), std::string::npos) << text;
  }
  EXPECT_NE(refusal(5, "", "fr3").find("model = \"fr3\", and the robot (protocol version 5) is Franka Emika Robot"), std::string::npos);
}

// What a URDF says of joint 4, and what becomes of the limits.
models::Limits limits_with(const std::string& what, double value) {
  const std::string urdf = models::urdf(models::arm("fr3"), 10);
  const auto joint = urdf.find("<limit", urdf.find("\"joint4\"")), from = urdf.find(what + "=\"", joint) + what.size() + 2;
  ArmModel model;
  model.arm = &models::arm("fr3");
  model.urdf = urdf.substr(0, from) + std::to_string(value) + urdf.substr(urdf.find('"', from));
  return scaled_limits(model, 10, ArmConfig());
}

TEST(ArmModel, LimitsAreTheNarrowerOfTheRobotsAndTheTables) {
  const models::Limits& table = models::limits(models::arm("fr3"), 10);
  EXPECT_DOUBLE_EQ(limits_with("lower", -3.0).q_min[3], -3.0 + kBeforeEnd);
  EXPECT_DOUBLE_EQ(limits_with("upper", -0.5).q_max[3], -0.5 - kBeforeEnd);
  EXPECT_DOUBLE_EQ(limits_with("velocity", 1.5).dq_max[3], 1.5);
  EXPECT_DOUBLE_EQ(limits_with("effort", 50).tau_max[3], 50);
  // The velocity towards the end of the range goes with it.
  EXPECT_NEAR(limits_with("upper", -0.5).dq_upper(3, -0.7), table.dq_upper(3, table.q_max[3] - 0.2), 1e-12);
  EXPECT_LT(limits_with("upper", -0.5).dq_upper(3, -0.7), table.dq_upper(3, -0.7));

  // Nothing wider than the table, and nothing of what is no bound.
  const models::Limits own = limits_with("velocity", 1000);
  for (int i = 0; i < 7; ++i) {
    EXPECT_DOUBLE_EQ(own.q_min[i], table.q_min[i] + kBeforeEnd);
    EXPECT_DOUBLE_EQ(own.q_max[i], table.q_max[i] - kBeforeEnd);
  }
  EXPECT_EQ(limits_with("lower", -4.0).q_min, own.q_min);
  EXPECT_EQ(limits_with("upper", 4.0).q_max, own.q_max);
  for (const double no_bound : {0.0, 1000.0, -1.0}) {
    EXPECT_EQ(limits_with("velocity", no_bound).dq_max, table.dq_max) << no_bound;
    EXPECT_EQ(limits_with("effort", no_bound).tau_max, table.tau_max) << no_bound;
  }
  for (const char* each : {"lower", "velocity", "effort"}) EXPECT_THROW(limits_with(each, NAN), std::invalid_argument) << each;
  EXPECT_EQ(limits_with("lower", 5.0).q_min, own.q_min) << "above upper";
  EXPECT_EQ(limits_with("upper", -3.5).q_max, own.q_max) << "below lower";
  EXPECT_THROW(limits_with("upper", table.q_min[3] + 1.9 * kBeforeEnd), std::invalid_argument) << "nothing left";
}

TEST(ArmModel, ARangeThatThisArmCannotHaveIsRefused) {
  std::string urdf = models::urdf(models::arm("fr3"), 10);
  const auto joint = urdf.find("\"joint6\""), lower = urdf.find("lower=\"", joint), velocity = urdf.find("velocity=", joint);
  urdf.replace(lower, velocity - lower, "lower=\"-1.5\" upper=\"0.1\" ");
  ArmModel model;
  model.arm = &models::arm("fr3");
  model.urdf = urdf;
  EXPECT_THROW(scaled_limits(model, 10, ArmConfig()), std::invalid_argument);
}

TEST(ArmModel, LimitsAreScaledAsConfigured) {
  ArmConfig config;
  config.limits = {0.5, 0.25, 0.1};
  const ArmModel model = choose_model(5, "", "auto");
  const models::Limits full = models::limits(*model.arm, 5), scaled = scaled_limits(model, 5, config);
  EXPECT_DOUBLE_EQ(scaled.dq_max[3], 0.5 * full.dq_max[3]);
  EXPECT_DOUBLE_EQ(scaled.ddq_max[3], 0.25 * full.ddq_max[3]);
  EXPECT_DOUBLE_EQ(scaled.translation.jerk, 0.1 * full.translation.jerk);
  EXPECT_DOUBLE_EQ(scaled.q_max[3], full.q_max[3] - kBeforeEnd) << "of a range there are no shares";
  EXPECT_EQ(scaled.tau_max, full.tau_max);
}

}  // namespace
}  // namespace server
