#include "sim/robot/internal_controller.hpp"

#include <gtest/gtest.h>

#include <random>

#include "tests/sim/arm_rig.hpp"

namespace sim {
namespace {

World::Options with_friction(const models::Arm& arm) {
  World::Options options;
  options.arm = &arm;
  return options;
}

class InternalControllerOf : public testing::TestWithParam<const char*> {
 protected:
  const models::Arm& arm = models::arm(GetParam());
};

TEST_P(InternalControllerOf, JointMotionsEndWhereTheyShould) {
  ArmRig rig(with_friction(arm));
  std::mt19937 random(4);
  std::uniform_real_distribution<double> way(-0.6, 0.6);
  for (int trial = 0; trial < 5; ++trial) {
    Joints goal = joints(models::kHome);
    for (double& q : goal) q += way(random);
    rig.move(goal, 1.5);
    rig.hold(0.3);
    EXPECT_LT((rig.q() - goal).cwiseAbs().maxCoeff(), 2e-4);
  }
}

TEST_P(InternalControllerOf, CartesianMotionsEndWhereTheyShould) {
  ArmRig rig(with_friction(arm));
  rig.cartesian = true;
  for (const Eigen::Matrix4d& goal :
       {pointing_down(0.5, 0.2, 0.2), pointing_down(0.4, -0.3, 0.4), pointing_down(0.6, 0, 0.1)}) {
    rig.move(goal, 1.5);
    rig.hold(0.5);
    EXPECT_LT(distance(rig.O_T_TCP(), goal), 1e-3);
    EXPECT_LT(angle(rig.O_T_TCP(), goal), 0.003);
  }
}

// As compliant as the server's impedance controller often is.
TEST_P(InternalControllerOf, SoftMotionsEndAsNearAsFrictionAllows) {
  for (const bool is_ideal : {true, false}) {
    World::Options options = with_friction(arm);
    options.ideal = is_ideal;
    ArmRig rig(options);
    rig.cartesian = true;
    rig.controller.K_x << 600, 600, 600, 50, 50, 50;
    for (const Eigen::Matrix4d& goal :
         {pointing_down(0.5, 0.2, 0.2), pointing_down(0.4, -0.3, 0.4), pointing_down(0.6, 0, 0.1)}) {
      rig.move(goal, 2);
      rig.hold(1);
      EXPECT_LT(distance(rig.O_T_TCP(), goal), is_ideal ? 1e-4 : 0.005);
      EXPECT_LT(angle(rig.O_T_TCP(), goal), is_ideal ? 1e-3 : M_PI / 180);
    }
  }
}

TEST_P(InternalControllerOf, PushedTheJointsYieldByTheirStiffness) {
  ArmRig rig(ideal(arm));
  rig.controller.K_theta << 800, 700, 600, 500, 400, 300, 200;
  const Vector6 push = {8, -6, 10, 0.5, -0.3, 0.4};
  rig.world.push(push);
  rig.hold(2);
  rig.model.update_kinematics(rig.q());
  const Joints torque = rig.model.jacobian(rig.F_T_EE.topRightCorner<3, 1>()).transpose() * Wrench(push.data());
  const Joints yielded = rig.q() - joints(models::kHome);
  EXPECT_LT((rig.controller.K_theta.cwiseProduct(yielded) - torque).norm(), 1e-3 * torque.norm());
}

TEST_P(InternalControllerOf, PushedTheToolYieldsByItsStiffness) {
  ArmRig rig(ideal(arm));
  rig.cartesian = true;
  rig.controller.K_x << 400, 800, 1600, 40, 60, 80;
  const Eigen::Matrix4d before = rig.O_T_TCP();
  const Wrench push = (Wrench() << 4, -6, 8, 0.6, -0.4, 0.5).finished();
  Vector6 pushed;
  Wrench::Map(pushed.data()) = push;
  rig.world.push(pushed);
  rig.hold(3);
  const Eigen::Matrix3d R = before.topLeftCorner<3, 3>();  // axes of K
  const Eigen::Vector3d moved = R.transpose() * (rig.O_T_TCP() - before).topRightCorner<3, 1>();
  const Eigen::Vector3d force = R.transpose() * push.head<3>();
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(moved[i] * rig.controller.K_x[i], force[i], 0.03);
  const Eigen::AngleAxisd turned(Eigen::Matrix3d(R.transpose() * rig.O_T_TCP().topLeftCorner<3, 3>()));
  const Eigen::Vector3d moment = R.transpose() * push.tail<3>();
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR((turned.angle() * turned.axis())[i] * rig.controller.K_x[3 + i], moment[i], 0.02);
  }
}

// Softest and stiffest that the robot accepts, anywhere, pushed as hard as its joints bear.
TEST_P(InternalControllerOf, ComesToRestAfterAnyPush) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> inside(0.1, 0.9), push(-40, 40);
  const models::Limits& limits = models::limits(arm, 10);
  for (int trial = 0; trial < 12; ++trial) {
    World::Options options = with_friction(arm);
    for (int i = 0; i < 7; ++i) {
      options.q[i] = limits.q_min[i] + inside(random) * (limits.q_max[i] - limits.q_min[i]);
    }
    ArmRig rig(options);
    const bool cartesian = rig.cartesian = trial % 2;
    if (trial % 4 == 0) rig.controller.K_theta.setConstant(14250);
    if (trial % 4 == 1) rig.controller.K_x << 3000, 3000, 3000, 300, 300, 300;
    if (trial % 4 == 2) rig.controller.K_theta.setConstant(100);
    if (trial % 4 == 3) rig.controller.K_x << 100, 100, 100, 10, 10, 10;
    rig.world.push({push(random), push(random), push(random), 0, 0, 0});
    rig.hold(0.2);
    rig.world.push({});
    rig.hold(5);  // soft ones are slow, and some lie on the floor
    EXPECT_LT(rig.dq().norm(), 0.02) << "trial " << trial << (cartesian ? ", Cartesian" : ", joints");
  }
}

INSTANTIATE_TEST_SUITE_P(Arms, InternalControllerOf, testing::Values("fer", "fr3", "fr3v2"),
                         [](const auto& info) { return std::string(info.param); });

}  // namespace
}  // namespace sim
