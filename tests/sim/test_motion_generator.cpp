#include "sim/robot/motion_generator.hpp"

#include <gtest/gtest.h>

#include <random>

#include "sim/robot/dt.hpp"
#include "tests/sim/arm_rig.hpp"

namespace sim {
namespace {

using Mode = fci::MotionGeneratorMode;

class MotionGeneratorTest : public testing::Test {
 protected:
  const models::Arm& arm = models::arm("fr3");
  MotionGenerator generator{arm};
  const MotionGenerator::Desired& desired = generator.desired();
  Joints home = joints(models::kHome);
  Eigen::Matrix4d F_T_EE = F_T_hand_TCP();

  Eigen::Matrix4d forward(const Joints& q) {
    ArmModel model(arm);
    model.update_kinematics(q);
    return model.O_T_F() * F_T_EE;
  }
};

TEST_F(MotionGeneratorTest, StartsAtRest) {
  generator.start(Mode::kCartesianPosition, home, F_T_EE);
  EXPECT_EQ(desired.q, home);
  EXPECT_EQ(desired.dq, Joints::Zero());
  EXPECT_EQ(desired.ddq, Joints::Zero());
  EXPECT_LT((desired.O_T_EE_c - forward(home)).norm(), 1e-12);
  EXPECT_EQ(desired.O_dP_EE_c, Wrench::Zero());
  EXPECT_EQ(desired.elbow_c, (std::array<double, 2>{home[2], -1}));
  // The pose in which it stands moves nothing.
  generator.step(ArmRig::pose_command(desired.O_T_EE_c));
  EXPECT_LT(desired.dq.norm(), 1e-9);
}

TEST_F(MotionGeneratorTest, JointPositionsHaveTheirBackwardDifferences) {
  generator.start(Mode::kJointPosition, home, F_T_EE);
  fci::RobotCommand command;
  Joints q = home, dq = Joints::Zero();
  for (int i = 1; i < 100; ++i) {
    const Joints next = home + Joints::Constant(0.1 * std::pow(i * kDt, 3));
    command.q_c = array(next);
    generator.step(command);
    const Joints dq_next = (next - q) / kDt;
    EXPECT_LT((desired.q - next).norm(), 1e-15);
    EXPECT_LT((desired.dq - dq_next).norm(), 1e-9);
    EXPECT_LT((desired.ddq - (dq_next - dq) / kDt).norm(), 1e-6);
    EXPECT_LT((desired.O_T_EE_c - forward(next)).norm(), 1e-12);
    q = next;
    dq = dq_next;
  }
}

TEST_F(MotionGeneratorTest, JointVelocitiesAddUp) {
  generator.start(Mode::kJointVelocity, home, F_T_EE);
  fci::RobotCommand command;
  for (int i = 0; i < 500; ++i) {
    command.dq_c.fill(0.2);
    generator.step(command);
  }
  EXPECT_LT((desired.q - home - Joints::Constant(0.1)).norm(), 1e-12);
  EXPECT_LT((desired.dq - Joints::Constant(0.2)).norm(), 1e-9);
}

TEST_F(MotionGeneratorTest, PosesBecomeTheJointsTheyCameFrom) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> way(-0.35, 0.35);
  for (const auto& arm : models::arms()) {
    MotionGenerator generator(arm);
    for (int trial = 0; trial < 10; ++trial) {
      Joints goal = home;
      for (double& q : goal) q += way(random);
      goal[2] = home[2];  // the elbow is kept
      generator.start(Mode::kCartesianPosition, home, F_T_EE);
      for (int i = 1; i <= 800; ++i) {
        const Eigen::Matrix4d pose = forward(home + ArmRig::minimum_jerk(i / 800.0) * (goal - home));
        generator.step(ArmRig::pose_command(pose));
        ASSERT_LT((generator.desired().O_T_EE_d - pose).norm(), 1e-10);
      }
      EXPECT_LT((generator.desired().q - goal).norm(), 1e-8);
      EXPECT_LT(generator.desired().dq.norm(), 1e-3);
    }
  }
}

// What the inverse kinematics adds to the smoothness of a command is far below any limit (5000 rad/s³).
TEST_F(MotionGeneratorTest, SmoothPosesAreSmoothJoints) {
  generator.start(Mode::kCartesianPosition, home, F_T_EE);
  const Eigen::Matrix4d from = desired.O_T_EE_c;
  const Eigen::Matrix4d to = pointing_down(0.55, 0.25, 0.2);
  Joints ddq = Joints::Zero(), jerk = Joints::Zero();
  double largest_step = 0;
  for (int i = 1; i <= 2000; ++i) {
    generator.step(ArmRig::pose_command(ArmRig::between(from, to, ArmRig::minimum_jerk(i / 2000.0))));
    const Joints next = (desired.ddq - ddq) / kDt;
    if (i > 3) largest_step = std::max(largest_step, (next - jerk).cwiseAbs().maxCoeff());
    jerk = next;
    ddq = desired.ddq;
  }
  EXPECT_LT(largest_step, 5);
  EXPECT_LT((desired.O_T_EE_d - to).norm(), 1e-10);
}

TEST_F(MotionGeneratorTest, TwistsIntegrate) {
  generator.start(Mode::kCartesianVelocity, home, F_T_EE);
  const Eigen::Matrix4d from = desired.O_T_EE_c;
  fci::RobotCommand command;
  command.O_dP_EE_c = {0.1, -0.05, 0.02, 0, 0, 0.3};
  for (int i = 0; i < 1000; ++i) generator.step(command);
  const Eigen::Vector3d moved = (desired.O_T_EE_d - from).topRightCorner<3, 1>();
  EXPECT_LT((moved - Eigen::Vector3d(0.1, -0.05, 0.02)).norm(), 1e-9);
  const Eigen::Matrix3d turned = Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ()) * from.topLeftCorner<3, 3>();
  EXPECT_LT((desired.O_T_EE_d.topLeftCorner<3, 3>() - turned).norm(), 1e-9);
  EXPECT_LT((desired.O_dP_EE_c - Wrench(command.O_dP_EE_c.data())).norm(), 1e-9);
}

TEST_F(MotionGeneratorTest, ElbowStaysUnlessItIsCommanded) {
  Joints start = home;
  start[2] = 0.2;
  generator.start(Mode::kCartesianPosition, start, F_T_EE);
  const Eigen::Matrix4d pose = desired.O_T_EE_c;
  for (int i = 1; i <= 500; ++i) {
    Eigen::Matrix4d moved = pose;
    moved(1, 3) += 0.1 * ArmRig::minimum_jerk(i / 500.0);
    generator.step(ArmRig::pose_command(moved));
    ASSERT_NEAR(desired.q[2], 0.2, 1e-10);
  }
  fci::RobotCommand command = ArmRig::pose_command(desired.O_T_EE_c);
  command.valid_elbow = true;
  for (int i = 1; i <= 500; ++i) {
    command.elbow_c = {0.2 - 0.3 * ArmRig::minimum_jerk(i / 500.0), -1};
    generator.step(command);
    ASSERT_NEAR(desired.q[2], command.elbow_c[0], 1e-10);
    ASSERT_NEAR(desired.elbow_c[0], command.elbow_c[0], 1e-10);
    ASSERT_LT((desired.O_T_EE_d - desired.O_T_EE_c).norm(), 1e-9);
  }
}

TEST_F(MotionGeneratorTest, ElbowSignFlipsWithTheForearm) {
  Joints q = home;
  q[3] = -0.3;
  generator.start(Mode::kJointPosition, q, F_T_EE);
  EXPECT_EQ(desired.elbow_c[1], 1);
}

TEST_F(MotionGeneratorTest, LostCommandsAreExtrapolatedAtConstantAcceleration) {
  for (const Mode mode : {Mode::kJointPosition, Mode::kJointVelocity}) {
    generator.start(mode, home, F_T_EE);
    fci::RobotCommand command;
    for (int i = 1; i <= 20; ++i) {  // 1 rad/s²
      command.q_c = array(home + Joints::Constant(0.5 * i * (i + 1) * kDt * kDt));
      command.dq_c.fill(i * kDt);
      generator.step(command);
    }
    for (int i = 21; i <= 30; ++i) {
      generator.extrapolate();
      EXPECT_LT((desired.q - home - Joints::Constant(0.5 * i * (i + 1) * kDt * kDt)).norm(), 1e-9);
      EXPECT_LT((desired.ddq - Joints::Constant(1)).norm(), 1e-6);
    }
  }
  generator.start(Mode::kCartesianVelocity, home, F_T_EE);
  fci::RobotCommand command;
  for (int i = 1; i <= 20; ++i) {
    command.O_dP_EE_c = {0, i * kDt, 0, 0, 0, 0.5 * i * kDt};
    generator.step(command);
  }
  for (int i = 21; i <= 30; ++i) {
    generator.extrapolate();
    EXPECT_NEAR(desired.O_dP_EE_c[1], i * kDt, 1e-9);
    EXPECT_NEAR(desired.O_dP_EE_c[5], 0.5 * i * kDt, 1e-9);
    EXPECT_LT((desired.O_T_EE_d - desired.O_T_EE_c).norm(), 1e-9);
  }
}

TEST_F(MotionGeneratorTest, PosesOutOfReachLeaveTheJointsCalm) {
  const Joints fastest = 2 * joints(models::limits(arm, 10).dq_max);
  generator.start(Mode::kCartesianPosition, home, F_T_EE);
  const Eigen::Matrix4d from = desired.O_T_EE_c;
  Eigen::Matrix4d far = from;
  far.topRightCorner<3, 1>() << 1.5, 0.5, 0.8;
  for (int i = 1; i <= 3000; ++i) {
    generator.step(ArmRig::pose_command(ArmRig::between(from, far, std::min(1.0, i / 2000.0))));
    ASSERT_TRUE(desired.q.allFinite());
    ASSERT_TRUE((desired.dq.array().abs() <= fastest.array() + 1e-9).all());
  }
  EXPECT_GT(distance(desired.O_T_EE_d, far), 0.3);
  EXPECT_LT((desired.O_T_EE_c - far).norm(), 1e-12);  // what was asked for
  // A pose that jumps is followed, not jumped to.
  generator.start(Mode::kCartesianPosition, home, F_T_EE);
  for (int i = 0; i < 1000; ++i) {
    generator.step(ArmRig::pose_command(pointing_down(0.45, 0.2, 0.3)));
    ASSERT_TRUE((desired.dq.array().abs() <= fastest.array() + 1e-9).all());
  }
  EXPECT_LT((desired.O_T_EE_d - pointing_down(0.45, 0.2, 0.3)).norm(), 1e-9);
}

TEST_F(MotionGeneratorTest, NothingMovesWithoutAMotionGenerator) {
  for (const Mode mode : {Mode::kIdle, Mode::kNone}) {
    generator.start(mode, home, F_T_EE);
    fci::RobotCommand command;
    command.q_c.fill(1);
    command.dq_c.fill(1);
    generator.step(command);
    generator.extrapolate();
    EXPECT_EQ(desired.q, home);
    EXPECT_EQ(desired.dq, Joints::Zero());
  }
}

}  // namespace
}  // namespace sim
