#include "realtime/momentum_observer.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

#include "allocation_counter.hpp"
#include "simulated_arm.hpp"

namespace {

using realtime::MomentumObserver;
using realtime::Vector3;
using realtime::Vector6;
using realtime::Vector7;

const Vector3 kGravity(0, 0, -9.81);

// An arm that swings under torques, and what it is seen to do.
class ObserverOf : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    fci::RobotState& state = arm.state;
    state.EE_T_K = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    Vector3::Map(state.O_ddP_O.data()) = kGravity;
  }

  // So many cycles, of which the observer sees the last: with more than one the others' states are lost.
  void go(const Vector7& external = Vector7::Zero(), std::uint64_t cycles = 1) {
    Vector7 tau_J = arm.tau;
    for (std::uint64_t n = 0; n < cycles; ++n) {
      const Vector7 torque = arm.tau, before = arm.model.gravity(kGravity);
      Vector7 next;
      for (int i = 0; i < 7; ++i) next[i] = i < 4 ? 6 * std::sin((8 + i) * arm.cycle.time) - arm.dq[i] : -0.05 * arm.dq[i];
      arm.step(next, external);
      tau_J = torque + (before + arm.model.gravity(kGravity)) / 2;
      fastest = std::max(fastest, arm.dq.cwiseAbs().maxCoeff());
    }
    Vector7::Map(arm.state.q.data()) = arm.q;
    Vector7::Map(arm.state.dq.data()) = arm.dq;
    Vector7::Map(arm.state.tau_J.data()) = tau_J;
    observer.update(arm.state, arm.model, cycles);
  }

  testing_tools::SimulatedArm arm{GetParam()};
  MomentumObserver observer;
  double fastest = 0;  // rad/s
};

INSTANTIATE_TEST_SUITE_P(Arms, ObserverOf, testing::Values("fer", "fr3"), [](const auto& info) { return std::string(info.param); });

TEST_P(ObserverOf, finds_nothing_where_nothing_pushes) {
  double most = 0;
  for (int n = 0; n < 600; ++n) {
    go();
    most = std::max(most, observer.tau_ext().cwiseAbs().maxCoeff());
    EXPECT_FALSE(observer.collision());
  }
  EXPECT_GT(fastest, 0.5);
  EXPECT_LT(most, 0.1) << "at up to " << fastest << " rad/s";
}

TEST_P(ObserverOf, finds_a_torque_as_a_low_pass_of_its_gain_would) {
  for (int n = 0; n < 300; ++n) go();
  const Vector7 external = (Vector7() << 6, -7, 2, 3, -0.3, 0.3, 0.1).finished();
  for (int n = 1; n <= 60; ++n) {
    go(external);
    const double share = 1 - std::pow(1 + MomentumObserver::kGain * 1e-3, -n);
    for (int i = 0; i < 7; ++i) {
      EXPECT_NEAR(observer.tau_ext()[i], -share * external[i], 0.02 * std::abs(external[i]) + 0.1) << i << " after " << n;
    }
  }
  EXPECT_TRUE(observer.collision());
  for (int n = 0; n < 60; ++n) go();
  EXPECT_LT(observer.tau_ext().cwiseAbs().maxCoeff(), 0.1);
}

TEST_P(ObserverOf, says_what_wrench_at_the_stiffness_frame_that_is) {
  const Vector3 EE_x_K(0, 0.02, 0.1);
  Vector3::Map(arm.state.EE_T_K.data() + 12) = EE_x_K;
  const Vector6 at_K = (Vector6() << 5, -8, 12, 0.6, 0.3, -0.4).finished();
  for (int n = 0; n < 200; ++n) {
    Vector6 at_EE = at_K;
    at_EE.tail<3>() += (arm.cycle.O_T_EE.linear() * EE_x_K).cross(at_K.head<3>());
    go(arm.model.jacobian().transpose() * at_EE);
  }
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(observer.O_F_ext_K()[i], -at_K[i], i < 3 ? 0.6 : 0.2) << i;  // it is damped
}

TEST_P(ObserverOf, goes_on_from_what_it_knew_where_states_were_lost) {
  const Vector7 external = (Vector7() << 0, 6, 0, 0, 0, 0, 0).finished();
  for (int n = 0; n < 200; ++n) go(external);
  for (const std::uint64_t cycles : {2, 5, 20}) {
    const Vector7 knew = observer.tau_ext();
    go(external, cycles);
    EXPECT_EQ(observer.tau_ext(), knew);
    for (int n = 0; n < 30; ++n) {
      go(external);
      EXPECT_NEAR(observer.tau_ext()[1], -6, 0.1);
    }
  }
}

TEST_P(ObserverOf, begins_anew_with_another_load) {
  for (int n = 0; n < 200; ++n) go();
  arm.set_tool(3, Vector3(0, 0, 0.15));
  observer.reset();
  for (int n = 0; n < 100; ++n) {
    go();
    EXPECT_LT(observer.tau_ext().cwiseAbs().maxCoeff(), 0.08);
  }
}

TEST_P(ObserverOf, a_torque_that_is_not_finite_is_forgotten) {
  for (int n = 0; n < 10; ++n) go();
  arm.state.tau_J[3] = std::numeric_limits<double>::quiet_NaN();
  observer.update(arm.state, arm.model, 1);
  EXPECT_TRUE(observer.tau_ext().allFinite() && observer.O_F_ext_K().allFinite());
  for (int n = 0; n < 100; ++n) go();
  EXPECT_LT(observer.tau_ext().cwiseAbs().maxCoeff(), 0.06);
}

TEST_P(ObserverOf, takes_nothing_from_the_heap) {
  go();
  const testing_tools::AllocationCounter allocations;
  for (int n = 0; n < 10; ++n) go();
  EXPECT_EQ(allocations.count(), 0u);
}

}  // namespace
