#include "realtime/pose_joints.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "realtime/rotation.hpp"

namespace {

using namespace realtime;

class PoseJointsOf : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Arms, PoseJointsOf, testing::Values("fer", "fr3"));

// Down beside the base the hand turns through straight below the elbow, where the six joints that follow are singular.
TEST_P(PoseJointsOf, go_through_a_singular_posture_that_is_on_the_way) {
  const models::Arm& arm = models::arm(GetParam());
  Model model(models::urdf(arm, arm.newest_version));
  PoseJoints joints(model, models::limits(arm, arm.newest_version));
  const Vector7 home = Vector7::Map(models::kHome.data());
  for (const int samples : {100, 300, 1000, 4000}) {
    joints.place(home);
    CartesianReference pose = at(model.O_T_EE(home));
    const Eigen::Vector3d from = pose.position, way(0.1, -0.2, -0.6);
    double missed = 0, least = 0, most = 0;
    for (int k = 0; k <= samples; ++k) {
      pose.position = from + way * k / samples;
      for (int n = 0; n < 3; ++n) joints.step(pose, 0);
      const JointsOfPose here = model.joints_of_pose(joints.joints().q);
      missed = std::max(missed, change_between(at(here.O_T_EE), pose).norm());
      least = std::min(least, here.determinant);
      most = std::max(most, here.determinant);
    }
    EXPECT_LT(missed, 2e-3) << samples;
    EXPECT_LT(least, -0.03) << samples;
    EXPECT_GT(most, 1e-4) << samples;
  }
}

}  // namespace
