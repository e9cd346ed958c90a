#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "allocation_counter.hpp"
#include "dt.hpp"
#include "home.hpp"
#include "models/joint_figures.hpp"
#include "realtime/bounds.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/motion_gate.hpp"
#include "realtime/power_taken.hpp"
#include "simulated_arm.hpp"

namespace {

using namespace realtime;
using testing_tools::SimulatedArm;

const models::Limits& kLimits = models::limits(models::arm("fr3"), 10);

models::Limits scaled(double velocity, double acceleration, double jerk) {
  models::Limits limits = kLimits;
  for (int i = 0; i < 7; ++i) {
    limits.dq_max[i] *= velocity;
    limits.ddq_max[i] *= acceleration;
    limits.dddq_max[i] *= jerk;
  }
  for (auto* rates : {&limits.translation, &limits.rotation}) {
    rates->velocity *= velocity;
    rates->acceleration *= acceleration;
    rates->jerk *= jerk;
  }
  return limits;
}

double share_of(const Vector7& x, const models::Vector7& limit) {
  return x.cwiseAbs().cwiseQuotient(Vector7::Map(limit.data())).maxCoeff();
}

// Backward differences of outputs, by the limits of each joint.
struct Judge {
  Vector7 q, v = Vector7::Zero(), a = Vector7::Zero();
  double velocity = 0, acceleration = 0, jerk = 0;  // the greatest

  explicit Judge(const Vector7& from) : q(from) {}
  void see(const Vector7& next) {
    const Vector7 v1 = (next - q) / kDt, a1 = (v1 - v) / kDt, j1 = (a1 - a) / kDt;
    velocity = std::max(velocity, share_of(v1, kLimits.dq_max));
    acceleration = std::max(acceleration, share_of(a1, kLimits.ddq_max));
    jerk = std::max(jerk, share_of(j1, kLimits.dddq_max));
    q = next;
    v = v1;
    a = a1;
  }
};

Reference joints(const Vector7& q) {
  Reference reference;
  reference.joint.q = q;
  return reference;
}

// Targets that jump, and ways between them that are too fast: what scripts and streams ask for.
struct Targets {
  std::mt19937 engine;
  Vector7 from = home(), to = home();
  double time = 0, duration = 0;

  Reference next() {
    if (time >= duration) {
      from = to;
      std::uniform_real_distribution<> way(-0.5, 0.5), seconds(0.2, 1.2);
      for (int i = 0; i < 7; ++i) to[i] = home()[i] + way(engine);
      duration = seconds(engine);
      time = 0;
    }
    time += kDt;
    const double s = std::min(time / duration, 1.);
    Reference wanted = joints(from + (10 * s * s * s - 15 * s * s * s * s + 6 * s * s * s * s * s) * (to - from));
    wanted.joint.dq = (30 * s * s - 60 * s * s * s + 30 * s * s * s * s) / duration * (to - from);
    wanted.joint.ddq = (60 * s - 180 * s * s + 120 * s * s * s) / (duration * duration) * (to - from);
    return wanted;
  }
};

TEST(Bounds, whatever_is_asked_for_stays_below_reduced_limits) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    for (const bool reduced : {true, false}) {
      Limiter limiter(kLimits);
      if (reduced) limiter.reduce(scaled(0.3, 0.4, 0.5));
      limiter.reset(joints(home()));
      Targets targets{std::mt19937(seed)};
      Judge judge(home());
      Reference out;
      for (int cycle = 0; cycle < 10000; ++cycle) {
        limiter.follow(targets.next(), kDt, out);
        judge.see(out.joint.q);
      }
      if (!reduced) {
        EXPECT_GT(judge.velocity, 0.35) << "they ask for more";
        EXPECT_GT(judge.acceleration, 0.5);
        continue;
      }
      EXPECT_LE(judge.velocity, 0.3) << "seed " << seed;
      EXPECT_GT(judge.velocity, 0.25);
      EXPECT_LE(judge.acceleration, 0.4) << "seed " << seed;
      EXPECT_LE(judge.jerk, 0.5) << "seed " << seed;
    }
  }
}

TEST(Bounds, a_motion_that_runs_is_slowed_inside_the_limits_of_the_arm) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    Limiter limiter(kLimits);
    limiter.reset(joints(home()));
    Targets targets{std::mt19937(seed)};
    Judge judge(home());
    Reference out;
    int slowed = 0;
    for (int cycle = 0; cycle < 20000; ++cycle) {
      if (cycle % 1000 == 500) limiter.reduce(scaled(0.1, 1, 1));
      if (cycle % 1000 == 0) limiter.reduce(kLimits);
      limiter.follow(targets.next(), kDt, out);
      judge.see(out.joint.q);
      const double now = share_of(judge.v, kLimits.dq_max);
      if (cycle % 1000 == 500 && now > 0.2) ++slowed;
      if (cycle % 1000 > 950) {
        EXPECT_LE(now, 0.1) << "seed " << seed << ", cycle " << cycle;
      }
    }
    EXPECT_GT(slowed, 2) << "it was faster";
    EXPECT_LE(judge.acceleration, 1);
    EXPECT_LE(judge.jerk, 1);
  }
}

// m/s of EE, by differences of the forward kinematics.
double tool_speed(Model& model, const Vector7& before, const Vector7& now) {
  return (model.O_T_EE(now).translation() - model.O_T_EE(before).translation()).norm() / kDt;
}

class GateTest : public testing::Test {
 protected:
  // One cycle of an arm that is where its reference is.
  HeldBy step(const Reference& wanted) {
    arm.model.update(reference.joint.q, reference.joint.dq);
    gate.observe(reference, arm.model.gravity({0, 0, -9.81}), nullptr);
    const testing_tools::AllocationCounter counter;
    const HeldBy held = gate.follow(wanted, reference);
    if (allocations::kCounts) {
      EXPECT_EQ(counter.count(), 0u);
    }
    return held;
  }

  SimulatedArm arm{"fr3"};
  MotionGate gate{kLimits, arm.model};
  Reference reference = joints(home());
};

TEST_F(GateTest, joints_do_not_move_the_tool_faster_than_may_be) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    for (const double most : {0.25, 1e9}) {
      Bounds bounds(kLimits);
      bounds.limits.translation.velocity = std::min(bounds.limits.translation.velocity, most);
      if (most < 1) bounds.tool_speed = most;
      reference = joints(home());
      gate.keep_to(bounds);
      gate.reset(reference);
      Targets targets{std::mt19937(seed)};
      Judge judge(home());
      double fastest = 0;
      HeldBy held = HeldBy::kNothing;
      for (int cycle = 0; cycle < 10000; ++cycle) {
        const Vector7 before = reference.joint.q;
        held |= step(targets.next());
        judge.see(reference.joint.q);
        fastest = std::max(fastest, tool_speed(arm.model, before, reference.joint.q));
      }
      EXPECT_LE(judge.acceleration, 1) << "seed " << seed;
      EXPECT_LE(judge.jerk, 1) << "seed " << seed;
      if (most > 1) {
        EXPECT_GT(fastest, 0.5) << "they ask for more";
        continue;
      }
      EXPECT_LE(fastest, most) << "seed " << seed;
      EXPECT_GT(fastest, 0.8 * most) << "seed " << seed;
      EXPECT_TRUE(has(held, HeldBy::kToolSpeed));
    }
  }
}

// The FER's joints move an arm that reaches out at more than 1.7 m/s, which is what the robot allows.
TEST(FerGateTest, joints_do_not_move_the_tool_faster_than_the_robot_allows) {
  SimulatedArm arm{"fer"};
  const models::Limits& limits = models::limits(models::arm("fer"), 5);
  MotionGate gate(limits, arm.model);
  Vector7 goal = (Vector7() << -2.5, 1.2, 0, -0.6, 0, 1.8, 0).finished();
  Reference reference = joints(goal);
  gate.reset(reference);
  goal = (Vector7() << 2.5, 1.6, 0, -0.1, 0, 1.8, 0).finished();
  double fastest = 0;
  for (int cycle = 0; cycle < 20000 && (reference.joint.q - goal).norm() > 1e-6; ++cycle) {
    const Vector7 before = reference.joint.q;
    arm.model.update(reference.joint.q, reference.joint.dq);
    gate.observe(reference, arm.model.gravity({0, 0, -9.81}), nullptr);
    gate.follow(joints(goal), reference);
    fastest = std::max(fastest, tool_speed(arm.model, before, reference.joint.q));
  }
  EXPECT_LT((reference.joint.q - goal).norm(), 1e-6);
  EXPECT_LE(fastest, limits.translation.velocity);
  EXPECT_GT(fastest, 0.8 * limits.translation.velocity);
}

TEST_F(GateTest, a_goal_is_reached_at_the_speed_that_the_tool_may_have) {
  Bounds bounds(kLimits);
  bounds.tool_speed = bounds.limits.translation.velocity = 0.2;
  gate.keep_to(bounds);
  gate.reset(reference);
  Vector7 goal = home();
  goal += (Vector7() << 0.8, 0.3, -0.2, 0.3, 0.4, -0.3, 0.5).finished();
  double length = 0;
  int cycles = 0, cruising = 0;
  for (; cycles < 20000 && (reference.joint.q - goal).norm() > 1e-6; ++cycles) {
    const Vector7 before = reference.joint.q;
    step(joints(goal));
    const double speed = tool_speed(arm.model, before, reference.joint.q);
    length += speed * kDt;
    cruising += reference.joint.ddq.cwiseAbs().maxCoeff() < 0.5;
    ASSERT_LE(speed, 0.2);
  }
  EXPECT_LT(cycles * kDt, 3 * length / 0.2) << "and not much slower";
  EXPECT_GT(cruising, cycles * 3 / 4) << "evenly";
}

TEST_F(GateTest, joints_do_no_more_work_than_may_be) {
  for (const double most : {10., 1e9}) {
    Bounds bounds(kLimits);
    if (most < 1e3) bounds.power = most;
    reference = joints(home());
    gate.keep_to(bounds);
    gate.reset(reference);
    Targets targets{std::mt19937(4)};
    double hardest = 0;
    for (int cycle = 0; cycle < 10000; ++cycle) {
      const Vector7 before = reference.joint.dq;
      step(targets.next());
      const Vector7 ddq = (reference.joint.dq - before) / kDt;
      hardest = std::max(hardest, before.dot(felt_inertia(arm.model.mass()) * ddq + arm.model.coriolis()));
    }
    if (most < 1e3) {
      EXPECT_LE(hardest, most);
    } else {
      EXPECT_GT(hardest, 15) << "they ask for more";
    }
  }
}

// A heavy tool is lifted from far out while all joints move.
TEST_F(GateTest, joints_take_no_more_than_the_robot_has) {
  arm.model.set_tool(3, {0, 0, 0.1}, Eigen::Matrix3d::Zero(), Eigen::Isometry3d::Identity());
  const Vector7 low = (Vector7() << -1.5, 1.6, 0, -0.4, 0, 1.6, 0).finished();
  const Vector7 high = (Vector7() << 1.5, -1.2, 0.3, -2.4, 1, 2.4, 1.5).finished();
  const auto most_taken = [&](const auto& next) {
    reference = joints(low);
    gate.reset(reference);
    double most = 0;
    Vector7 before = reference.joint.dq;
    for (int cycle = 0; cycle < 20000 && (reference.joint.q - high).norm() > 1e-6; ++cycle) {
      next();
      const Vector7 ddq = (reference.joint.dq - before) / kDt;
      before = reference.joint.dq;
      arm.model.update(reference.joint.q, before);
      const Vector7 tau = felt_inertia(arm.model.mass()) * ddq + arm.model.coriolis() + arm.model.gravity({0, 0, -9.81});
      most = std::max(most, power_taken(tau, before));
    }
    EXPECT_LT((reference.joint.q - high).norm(), 1e-6);
    return most;
  };
  Limiter alone(kLimits);
  alone.reset(joints(low));
  EXPECT_GT(most_taken([&] { alone.follow(joints(high), kDt, reference); }), models::kMostPower) << "it would take more";
  HeldBy held = HeldBy::kNothing;
  EXPECT_LE(most_taken([&] { held |= step(joints(high)); }), models::kMostPower);
  EXPECT_TRUE(has(held, HeldBy::kPower));
}

}  // namespace
