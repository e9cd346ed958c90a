#include "realtime/joint_barrier.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "realtime/cholesky.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/joint_range.hpp"
#include "realtime/limiter.hpp"
#include "tests/realtime/simulated_arm.hpp"

namespace realtime {
namespace {

using testing_tools::SimulatedArm;

class Barrier : public testing::TestWithParam<const char*> {
 protected:
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  JointBarrier barrier{limits};

  // How far a joint that is pushed by this share of its greatest torque comes out of its range, rad, and by which share it
  // is too fast.
  struct Worst {
    double beyond = -10, speed = 0;
  };
  Worst pushed(int joint, double share, bool with_barrier, double seconds = 1.5) {
    SimulatedArm arm(GetParam(), Vector7::Map(models::kMotorInertia.data()));
    TorqueLimiter torque_limiter(limits);
    Worst worst;
    Vector7 last = Vector7::Zero();
    for (int cycle = 0; cycle < 1000 * seconds; ++cycle) {
      Vector7 tau = arm.model.coriolis() - arm.dq;  // as light as a guided arm
      tau[joint] += share * limits.tau_max[joint];
      if (with_barrier) barrier.add(arm.q, arm.dq, joint_mobility(arm.model.mass()), arm.model.coriolis(), {}, tau);
      torque_limiter.limit(tau, last, SimulatedArm::kDt, last);
      arm.step(last);
      for (int i = 0; i < models::kJoints; ++i) {
        worst.beyond = std::max({worst.beyond, arm.q[i] - limits.q_max[i], limits.q_min[i] - arm.q[i]});
        const double allowed = arm.dq[i] > 0 ? limits.dq_upper(i, arm.q[i]) : -limits.dq_lower(i, arm.q[i]);
        worst.speed = std::max(worst.speed, (std::abs(arm.dq[i]) - allowed) / limits.dq_max[i]);
      }
    }
    return worst;
  }
};

TEST_P(Barrier, KeepsAPushedArmInItsRangeAndItsSpeed) {
  for (int joint = 0; joint < models::kJoints; ++joint) {
    for (const double share : {-0.2, 0.2}) {
      const Worst worst = pushed(joint, share, true);
      EXPECT_LT(worst.beyond, 0.005) << "joint " << joint + 1 << " pushed by " << share;
      EXPECT_LT(worst.speed, 0.1) << "joint " << joint + 1 << " pushed by " << share;  // where the robot ends the motion
    }
  }
}

// A stiff controller far from its reference asks for all that the joints can give; damping alone would find its balance
// with that above the allowed speed.
TEST_P(Barrier, KeepsToTheSpeedAgainstAControllerThatPullsHard) {
  for (int joint = 0; joint < models::kJoints; ++joint) {
    for (const double share : {-0.8, 0.8}) {
      EXPECT_LT(pushed(joint, share, true, 0.3).speed, 0.1) << "joint " << joint + 1 << " pulled by " << share;
    }
  }
}

// Of the acceleration that the torque makes, which is found by the mass matrix, no more is left than leads to the greatest
// speed at 20 1/s; where it is less, the torque stays.
TEST_P(Barrier, TakesWhatLeadsBeyondTheSpeedAndNoMore) {
  SimulatedArm arm(GetParam(), Vector7::Zero());
  arm.dq[4] = 0.8 * limits.dq_max[4];
  arm.model.update(arm.q, arm.dq);
  const double room = 0.05 * limits.dq_max[4];  // of 0.85
  const Matrix7 M = felt_inertia(arm.model.mass()), mobility = joint_mobility(arm.model.mass());
  const auto accelerated = [&](double ddq) {
    Vector7 wanted = Vector7::Zero();
    wanted[4] = ddq;
    return Vector7(M * wanted + arm.model.coriolis());
  };
  Vector7 tau = accelerated(0.9 * 20 * room);
  const Vector7 before = tau;
  EXPECT_FALSE(barrier.add(arm.q, arm.dq, mobility, arm.model.coriolis(), {}, tau));
  EXPECT_LT((tau - before).norm(), 1e-9);
  tau = accelerated(2 * 20 * room);
  const Vector7 hard = tau;
  EXPECT_TRUE(barrier.add(arm.q, arm.dq, mobility, arm.model.coriolis(), {}, tau));
  for (int i = 0; i < models::kJoints; ++i) {
    if (i == 4) continue;
    EXPECT_NEAR(tau[i], hard[i], 1e-6) << "joint " << i + 1;
  }
  const Vector7 ddq = mobility * (tau - arm.model.coriolis());
  EXPECT_NEAR(ddq[4], 20 * room, 1e-6);
}

TEST_P(Barrier, IsNeeded) {
  int beyond = 0, fast = 0;
  for (int joint = 0; joint < models::kJoints; ++joint) {
    const Worst worst = pushed(joint, 0.2, false);
    beyond += worst.beyond > 0.05;
    fast += worst.speed > 0.1;
  }
  EXPECT_GE(beyond, 4);
  EXPECT_GE(fast, 4);
}

TEST_P(Barrier, LeavesAloneWhatCanStillBeBraked) {
  Vector7 tau = Vector7::Zero();
  const Matrix7 mobility = Matrix7::Identity();
  const Vector7 none = Vector7::Zero();
  Vector7 q = Vector7::Map(models::kHome.data());
  const auto half = 0.5 * Vector7::Map(limits.dq_max.data());
  EXPECT_FALSE(barrier.add(q, half, mobility, none, {}, tau));
  EXPECT_FALSE(barrier.add(q, -half, mobility, none, {}, tau));
  for (int i = 0; i < models::kJoints; ++i) q[i] = rest_max(limits, i) - 0.021;
  EXPECT_FALSE(barrier.add(q, Vector7::Zero(), mobility, none, {}, tau));
  EXPECT_FALSE(barrier.add(q, -half, mobility, none, {}, tau)) << "away from the end";
  EXPECT_EQ(tau, Vector7::Zero());
  EXPECT_TRUE(barrier.add(q, half, mobility, none, {}, tau));
  EXPECT_LT(tau.maxCoeff(), 0);
}

INSTANTIATE_TEST_SUITE_P(Arms, Barrier, testing::Values("fer", "fr3"), [](const auto& info) { return info.param; });

}  // namespace
}  // namespace realtime
