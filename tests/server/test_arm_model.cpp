#include <gtest/gtest.h>

#include <regex>

#include "server/arm_model.hpp"

namespace server {
namespace {

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
    const std::string renamed = std::regex_replace(urdf, std::regex("<robot name=\"[^\"]*\""), "<robot name=\"r2d2\"");
    ASSERT_NE(renamed, urdf);
    EXPECT_EQ(choose_model(10, renamed, "auto").arm->name, arm.name);
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

TEST(ArmModel, TheConfigurationGoesFirstAndIsChecked) {
  const std::string urdf = models::urdf(models::arm("fr3"), 10);
  EXPECT_EQ(choose_model(10, urdf, "fr3").warning, "");
  const ArmModel other = choose_model(10, urdf, "fr3v2");
  EXPECT_EQ(other.arm->name, "fr3v2");
  EXPECT_TRUE(other.urdf == models::urdf(models::arm("fr3v2"), 10));
  EXPECT_NE(other.warning.find("fr3v2"), std::string::npos);
  // Protocol 6 says that it is an FR3, not which.
  EXPECT_EQ(choose_model(6, "", "fr3v2").warning, "");
  EXPECT_NE(choose_model(6, "", "fer").warning, "");
}

TEST(ArmModel, LimitsAreScaledAsConfigured) {
  ArmConfig config;
  config.limits = {0.5, 0.25, 0.1};
  const auto& arm = models::arm("fer");
  const models::Limits full = models::limits(arm, 5), scaled = scaled_limits(arm, 5, config);
  EXPECT_DOUBLE_EQ(scaled.dq_max[3], 0.5 * full.dq_max[3]);
  EXPECT_DOUBLE_EQ(scaled.ddq_max[3], 0.25 * full.ddq_max[3]);
  EXPECT_DOUBLE_EQ(scaled.translation.jerk, 0.1 * full.translation.jerk);
  EXPECT_EQ(scaled.q_max, full.q_max);
  EXPECT_EQ(scaled.tau_max, full.tau_max);
}

}  // namespace
}  // namespace server
