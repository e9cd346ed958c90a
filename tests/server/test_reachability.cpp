#include <gtest/gtest.h>

#include <random>

#include "realtime/joint_range.hpp"
#include "server/reachability.hpp"

namespace server {
namespace {

const models::Limits& limits() { return models::limits(models::arm("fr3"), 10); }

TEST(Reachability, WhatTheJointsCanDoIsReached) {
  realtime::Model model(models::urdf(models::arm("fr3"), 10));
  std::mt19937 random(7);
  const realtime::Vector7 home = Eigen::Map<const realtime::Vector7>(models::kHome.data());
  for (int n = 0; n < 200; ++n) {
    realtime::Vector7 q;
    for (int i = 0; i < 7; ++i) {
      q[i] = std::uniform_real_distribution(realtime::rest_min(limits(), i), realtime::rest_max(limits(), i))(random);
    }
    const Eigen::Isometry3d goal = model.O_T_EE(q);
    const Reach result = reach(model, limits(), goal, home);
    ASSERT_TRUE(result.reached) << "posture " << n << ": " << q.transpose();
    // It is a posture, inside the limits, that is there.
    EXPECT_LT((model.O_T_EE(result.q).translation() - goal.translation()).norm(), 1e-3);
    for (int i = 0; i < 7; ++i) {
      EXPECT_GE(result.q[i], limits().q_min[i]);
      EXPECT_LE(result.q[i], limits().q_max[i]);
    }
  }
}

TEST(Reachability, WhatIsTooFarIsNot) {
  realtime::Model model(models::urdf(models::arm("fr3"), 10));
  const realtime::Vector7 home = Eigen::Map<const realtime::Vector7>(models::kHome.data());
  Eigen::Isometry3d goal = model.O_T_EE(home);
  goal.translation() = Eigen::Vector3d(1.5, 0, 0.333);
  const Reach result = reach(model, limits(), goal, home);
  EXPECT_FALSE(result.reached);
  // The flange gets 0.855 m from the shoulder at most, and this one may also turn less than it should.
  EXPECT_GT(result.distance, 1.5 - 0.86);
  EXPECT_LT(result.distance, 1.5 - 0.5);
}

}  // namespace
}  // namespace server
