#include "realtime/rejoin.hpp"

#include <gtest/gtest.h>

#include <random>
#include <string>

#include "dt.hpp"

namespace {

using realtime::Channels;
using realtime::Reference;
using realtime::Rejoin;
using realtime::Vector3;
using realtime::Vector7;

class Rejoining : public testing::TestWithParam<const char*> {
 protected:
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  std::mt19937 random{3};
  Vector3 any(double most) {
    std::uniform_real_distribution<> in(-most, most);
    return {in(random), in(random), in(random)};
  }
};

INSTANTIATE_TEST_SUITE_P(Arms, Rejoining, testing::Values("fer", "fr3"), [](const auto& info) { return std::string(info.param); });

// A reference that limits have kept behind while packets were lost would be held by them again.
TEST_P(Rejoining, what_cannot_be_in_a_twentieth_of_a_second_is_left_to_the_limits) {
  int active = 0;
  for (int n = 0; n < 200; ++n) {
    Reference wanted, is;
    wanted.motion = is.motion = Channels::kPose;
    const double much = 0.005 * n;
    is.cartesian.position = any(0.01 * much);
    is.cartesian.velocity << any(0.2 * much), Vector3::Zero();
    is.cartesian.acceleration << any(4 * much), Vector3::Zero();
    Rejoin rejoin(limits);
    rejoin.start(is, wanted);
    active += rejoin.active();
    Vector3 x = is.cartesian.position, v = is.cartesian.velocity.head<3>(), a = is.cartesian.acceleration.head<3>();
    while (rejoin.active()) {
      Reference at = wanted;
      rejoin.step(kDt, at);
      const Vector3 next = at.cartesian.position, next_v = at.cartesian.velocity.head<3>(), next_a = at.cartesian.acceleration.head<3>();
      // Of each of its three parts.
      EXPECT_LT((next_a - a).norm() / kDt, 3 * limits.translation.jerk);
      EXPECT_LT(next_a.norm(), 3 * limits.translation.acceleration);
      EXPECT_LT((next - x - kDt / 2 * (v + next_v)).norm(), kDt * kDt * kDt / 12 * 3 * limits.translation.jerk);
      x = next;
      v = next_v;
      a = next_a;
    }
  }
  EXPECT_GT(active, 20);
  EXPECT_LT(active, 180);
}

TEST_P(Rejoining, what_a_lost_command_makes_is_gone_in_a_twentieth_of_a_second) {
  Reference wanted, is;
  is.joint.q.setConstant(2e-6);
  is.joint.dq.setConstant(2e-3);
  is.joint.ddq.setConstant(1);
  Rejoin rejoin(limits);
  rejoin.start(is, wanted);
  int cycles = 0;
  for (Reference at; rejoin.active(); ++cycles) rejoin.step(kDt, at = wanted);
  EXPECT_EQ(cycles, 50);
}

}  // namespace
