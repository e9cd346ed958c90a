#include "realtime/torque_gate.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>
#include <tuple>

#include "models/joint_figures.hpp"
#include "realtime/power_taken.hpp"
#include "simulated_arm.hpp"

namespace {

using namespace realtime;
using testing_tools::kTolerated;
using testing_tools::SimulatedArm;
using testing_tools::too_fast;

// What a controller that pulls to and fro makes of an arm, with up to a share of what the joints can give.
struct Pulled {
  double speed = 0, power = 0, joint = 0;  // the greatest: m/s, W, share of the joints' velocity
  double taken = 0;                        // W
  HeldBy held = HeldBy::kNothing;
};

class PulledArm : public testing::TestWithParam<std::tuple<const char*, double>> {
 protected:
  const models::Limits& limits = models::limits(models::arm(std::get<0>(GetParam())), 10);
  const double share = std::get<1>(GetParam());
  const Bounds own{limits};

  Pulled pulled(const Bounds& bounds, unsigned seed) const {
    SimulatedArm arm(std::get<0>(GetParam()), Vector7::Map(models::kMotorInertia.data()));
    TorqueGate gate(limits);
    gate.keep_to(bounds);
    WallGuard walls;
    std::mt19937 engine(seed);
    std::uniform_real_distribution<> some(-share, share);
    Vector7 wanted, sent = Vector7::Zero();
    Pulled most;
    for (int cycle = 0; cycle < 4000; ++cycle) {
      if (cycle % 250 == 0) {
        for (int i = 0; i < 7; ++i) wanted[i] = some(engine) * limits.tau_max[i];
      }
      const Vector7 gravity = arm.model.gravity({0, 0, -9.81});
      most.held |= gate.pass(arm.cycle, walls, wanted, 0, sent);
      most.taken = std::max(most.taken, power_taken(sent + gravity, arm.dq));
      arm.step(sent);
      most.speed = std::max(most.speed, (arm.model.jacobian().topRows<3>() * arm.dq).norm());
      most.power = std::max(most.power, sent.dot(arm.dq));
      most.joint = std::max(most.joint, arm.dq.cwiseAbs().cwiseQuotient(Vector7::Map(limits.dq_max.data())).maxCoeff());
    }
    return most;
  }
};

constexpr unsigned kSeeds[] = {1, 2, 3, 4};

TEST_P(PulledArm, KeepsTheToolBelowItsSpeed) {
  for (const unsigned seed : kSeeds) {
    Bounds bounds = own;
    bounds.tool_speed = 0.25;
    EXPECT_GT(pulled(own, seed).speed, 0.3) << "it would be faster";
    EXPECT_LE(pulled(bounds, seed).speed, 0.25) << "seed " << seed;
  }
}

TEST_P(PulledArm, KeepsItsJointsBelowTheirSpeed) {
  for (const unsigned seed : kSeeds) {
    Bounds bounds = own;
    for (double& dq_max : bounds.limits.dq_max) dq_max *= 0.2;
    EXPECT_GT(pulled(own, seed).joint, 0.3) << "they would be faster";
    EXPECT_LE(pulled(bounds, seed).joint, 0.2) << "seed " << seed;
  }
}

TEST_P(PulledArm, ExertsNoMorePowerThanMayBe) {
  for (const unsigned seed : kSeeds) {
    Bounds bounds = own;
    EXPECT_GT(pulled(own, seed).power, 9);
    for (const double most : {3., 20.}) {
      bounds.power = most;
      EXPECT_LE(pulled(bounds, seed).power, most) << "seed " << seed;
    }
  }
}

TEST_P(PulledArm, TakesNoMoreThanTheRobotHas) {
  HeldBy held = HeldBy::kNothing;
  for (const unsigned seed : kSeeds) {
    const Pulled most = pulled(own, seed);
    EXPECT_LE(most.taken, models::kMostPower) << "seed " << seed;
    held |= most.held;
  }
  EXPECT_EQ(has(held, HeldBy::kPower), share > 0.5) << "more is asked for";
}

// However little may be asked for, an arm whose controller is at fault is braked with all that its joints have.
TEST(TorqueGate, WhatTheLoopItselfExertsIsNotReduced) {
  SimulatedArm arm("fr3", Vector7::Map(models::kMotorInertia.data()));
  const models::Limits& limits = models::limits(models::arm("fr3"), 10);
  const auto exerted = [&](double share, bool loops_own) {
    TorqueGate gate(limits);
    Bounds bounds{limits};
    for (double& tau_max : bounds.limits.tau_max) tau_max *= share;
    gate.keep_to(bounds);
    WallGuard walls;
    Vector7 sent = Vector7::Zero();
    const Vector7 wanted = Vector7::Map(limits.tau_max.data()) / 4;
    for (int cycle = 0; cycle < 100; ++cycle) gate.pass(arm.cycle, walls, wanted, 0, sent, loops_own);
    return sent;
  };
  EXPECT_LT(exerted(0.05, false)[0], 0.06 * limits.tau_max[0]);
  EXPECT_EQ(exerted(0.05, true), exerted(1, true));
  EXPECT_GT(exerted(0.05, true)[0], 0.2 * limits.tau_max[0]);
}

// Reaching out, the second joint of an arm bears a good half of what it can already.
TEST(TorqueGate, JointsBearNoMoreThanTheyCanWithWhatTheArmWeighs) {
  SimulatedArm arm("fr3", Vector7::Map(models::kMotorInertia.data()));
  const models::Limits& limits = models::limits(models::arm("fr3"), 10);
  TorqueGate gate(limits);
  WallGuard walls;
  arm.q << 0, 1.2, 0, -0.4, 0, 1.8, 0;
  arm.observe();
  const auto gravity = [&] { return arm.model.gravity({0, 0, -9.81}); };
  Vector7 wanted = Vector7::Zero(), sent = wanted;
  wanted[1] = -0.8 * limits.tau_max[1];
  ASSERT_LT((wanted + gravity())[1], -1.2 * limits.tau_max[1]);
  double least = 0;
  for (int cycle = 0; cycle < 100; ++cycle) {
    gate.pass(arm.cycle, walls, wanted, 0, sent);
    least = std::min(least, (sent + gravity())[1]);
    arm.step(sent);
  }
  EXPECT_GE(least, -limits.tau_max[1]);
  EXPECT_LT(least, -0.9 * limits.tau_max[1]) << "all that it can";
}

// Which alone is more than it.
TEST(TorqueGate, AReducedTorqueIsBesideWhatTheArmWeighs) {
  SimulatedArm arm("fr3", Vector7::Map(models::kMotorInertia.data()));
  const models::Limits& limits = models::limits(models::arm("fr3"), 10);
  Bounds bounds(limits);
  for (double& tau_max : bounds.limits.tau_max) tau_max *= 0.2;
  TorqueGate gate(limits);
  gate.keep_to(bounds);
  WallGuard walls;
  arm.q << 0, 1.2, 0, -0.4, 0, 1.8, 0;
  arm.observe();
  ASSERT_LT(arm.model.gravity({0, 0, -9.81})[1], -bounds.limits.tau_max[1]);
  Vector7 wanted = Vector7::Zero(), sent = wanted;
  wanted[1] = -limits.tau_max[1];
  for (int cycle = 0; cycle < 30; ++cycle) {
    gate.pass(arm.cycle, walls, wanted, 0, sent);
    arm.step(sent);
  }
  EXPECT_GE(sent[1], -bounds.limits.tau_max[1]);
  EXPECT_LT(sent[1], -0.9 * bounds.limits.tau_max[1]);
}

// To and fro by far too stiff springs: torques that have far to fall, of joints that move each other.
class SprungArm : public testing::TestWithParam<const char*> {};

TEST_P(SprungArm, IsNoFasterThanTheRobotAllows) {
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  const Vector7 q_min = Vector7::Map(limits.q_min.data()), q_max = Vector7::Map(limits.q_max.data());
  const Vector7 tau_max = Vector7::Map(limits.tau_max.data());
  for (unsigned seed = 1; seed <= 24; ++seed) {
    SimulatedArm arm(GetParam(), Vector7::Map(models::kMotorInertia.data()));
    TorqueGate gate(limits);
    WallGuard walls;
    std::mt19937 engine(seed);
    std::uniform_real_distribution<> some(0, 1);
    const double stiffness = seed % 2 == 0 ? 1 : 3;  // of what the joints can give, 1/rad
    const int every = seed % 4 < 2 ? 250 : 500;
    Vector7 goal = arm.q, sent = Vector7::Zero();
    for (int cycle = 0; cycle < 6000; ++cycle) {
      if (cycle % every == 0) {
        for (int i = 0; i < models::kJoints; ++i) goal[i] = q_min[i] + some(engine) * (q_max[i] - q_min[i]);
      }
      const Vector7 pull = stiffness * (goal - arm.q - 0.05 * arm.dq);
      gate.pass(arm.cycle, walls, tau_max.cwiseProduct(pull) + arm.model.coriolis(), 0, sent);
      arm.step(sent);
      ASSERT_LT(too_fast(arm, limits), kTolerated) << "seed " << seed << ", cycle " << cycle;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Arms, SprungArm, testing::Values("fer", "fr3"), [](const auto& info) { return info.param; });

// By the hand, up to 30 N hither and thither, while nothing holds it: too_fast(), and how fast the tool becomes (m/s).
class PushedArm : public testing::TestWithParam<const char*> {
 protected:
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);

  struct Worst {
    double joint = 0, tool = 0;
  };
  Worst pushed(unsigned seed, bool feels) const {
    SimulatedArm arm(GetParam(), Vector7::Map(models::kMotorInertia.data()));
    arm.feels = feels;
    TorqueGate gate(limits);
    WallGuard walls;
    std::mt19937 engine(seed);
    std::uniform_real_distribution<> some(-1, 1);
    Vector3 force = Vector3::Zero();
    Vector7 sent = Vector7::Zero();
    Worst worst;
    for (int cycle = 0; cycle < 6000; ++cycle) {
      if (cycle % 600 == 0) force = 30 * Vector3(some(engine), some(engine), some(engine)).normalized();
      gate.pass(arm.cycle, walls, arm.model.coriolis(), 0, sent);
      const Vector7 push = arm.model.jacobian().topRows<3>().transpose() * force;
      arm.step(sent, push);
      worst.joint = std::max(worst.joint, too_fast(arm, limits));
      worst.tool = std::max(worst.tool, (arm.model.jacobian().topRows<3>() * arm.dq).norm());
    }
    return worst;
  }
};

TEST_P(PushedArm, IsNoFasterThanTheRobotAllows) {
  double unfelt = 0;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const Worst worst = pushed(seed, true);
    EXPECT_LT(worst.joint, kTolerated) << "seed " << seed;
    EXPECT_LT(worst.tool, 1.1 * limits.translation.velocity) << "seed " << seed;
    unfelt = std::max(unfelt, pushed(seed, false).joint);
  }
  EXPECT_GT(unfelt, kTolerated) << "it would be, were it not felt";
}

INSTANTIATE_TEST_SUITE_P(Arms, PushedArm, testing::Values("fer", "fr3"), [](const auto& info) { return info.param; });

INSTANTIATE_TEST_SUITE_P(Arms, PulledArm, testing::Combine(testing::Values("fer", "fr3"), testing::Values(0.2, 0.6)),
                         [](const auto& info) {
                           return std::string(std::get<0>(info.param)) + (std::get<1>(info.param) > 0.5 ? "_hard" : "_soft");
                         });

}  // namespace
