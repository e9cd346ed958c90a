#include "realtime/motion_gate.hpp"

#include <gtest/gtest.h>

#include "models/arm.hpp"
#include "realtime/rotation.hpp"
#include "realtime/tick.hpp"

namespace {

using namespace realtime;

class PoseOutOfReach : public testing::TestWithParam<std::tuple<const char*, Eigen::Vector3d>> {};

std::string names(const testing::TestParamInfo<PoseOutOfReach::ParamType>& info) {
  return std::get<0>(info.param) + std::to_string(info.index);
}
INSTANTIATE_TEST_SUITE_P(Arms, PoseOutOfReach,
                         testing::Combine(testing::Values("fer", "fr3"),
                                          testing::Values(Eigen::Vector3d(1.9, 0, 0.4), Eigen::Vector3d(0.8, 0, 0.4),
                                                          Eigen::Vector3d(0.3, 0.9, 0.3), Eigen::Vector3d(0.3, 0, 1.6))),
                         names);

// Out as far as it goes, again and again, and home: the joints go along as fast as they may and no faster.
TEST_P(PoseOutOfReach, is_gone_to_as_far_as_joints_reach_and_left_again) {
  const auto& [name, place] = GetParam();
  const models::Arm& arm = models::arm(name);
  const models::Limits& limits = models::limits(arm, 10);
  Model model(models::urdf(arm, 10));
  MotionGate gate(limits, model);
  Reference reference;
  reference.motion = Channels::kPose;
  const Vector7 home = Vector7::Map(models::kHome.data());
  model.update(home, Vector7::Zero());
  reference.cartesian = at(model.O_T_EE());
  const Reference back = reference;
  Reference out = reference;
  out.cartesian.position = place;
  gate.place(home);
  gate.reset(reference);
  Vector7 q = home;
  const auto go = [&](const Reference& wanted, int most) {
    for (int k = 0; k < most; ++k) {
      if ((reference.cartesian.position - wanted.cartesian.position).norm() < 1e-4) return;
      gate.observe(reference, Vector7::Zero(), nullptr);
      const Vector7 step = gate.joints().q - q;
      for (int i = 0; i < models::kJoints; ++i) {
        EXPECT_LT(std::abs(step[i]), 1.5 * limits.dq_max[i] * kTick) << "joint " << i + 1 << ", cycle " << k;
      }
      q = gate.joints().q;
      model.update(q, Vector7::Zero());
      gate.follow(wanted, reference);
      if (HasFailure()) return;
    }
  };
  for (int n = 0; n < 2; ++n) {
    go(out, 15'000);
    const double farthest = (reference.cartesian.position - back.cartesian.position).norm();
    EXPECT_GT(farthest, 0.15) << n;
    EXPECT_LT((model.O_T_EE(q).translation() - reference.cartesian.position).norm(), 0.04) << n;
    go(back, 60'000);  // from the end of its reach it leaves slowly
    EXPECT_LT((reference.cartesian.position - back.cartesian.position).norm(), 1e-3) << n;
    EXPECT_LT((model.O_T_EE(q).translation() - back.cartesian.position).norm(), 2e-3) << n;
  }
}

}  // namespace
