#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "realtime/pose_joints.hpp"
#include "realtime/tool.hpp"
#include "realtime/trajectories/paced.hpp"
#include "server/path_pace.hpp"
#include "server/reachability.hpp"
#include "server/refused.hpp"
#include "tests/realtime/at_home.hpp"
#include "tests/realtime/singular_posture.hpp"
#include "tests/server/skills.hpp"

namespace server {
namespace {

class SkillBuilderTest : public testing::Test {
 protected:
  std::string error_of(const proto::Skill& skill) {
    try {
      builder_.build(skill, now_);
    } catch (const Refused& refused) {
      EXPECT_EQ(refused.code, proto::Error::INVALID_ARGUMENT);
      return refused.what();
    }
    return "no error";
  }

  realtime::Record now_ = record_at_home();
  SkillBuilder builder_{fr3_model(), fr3_limits()};
};

TEST_F(SkillBuilderTest, BuildsWhatFits) {
  auto message = skill_of(joint_motion(), proto::JointImpedance());
  message.add_terminations()->PackFrom(proto::FinalJoint());
  proto::Time time;
  time.set_seconds(3);
  message.add_terminations()->PackFrom(time);
  const auto skill = builder_.build(message, now_);
  EXPECT_EQ(motion_of(skill->trajectory->fills()), realtime::Channels::kJoint);
  EXPECT_EQ(skill->mode, robot::kTorque);
  EXPECT_EQ(skill->terminations.size(), 2u);
  EXPECT_EQ(skill->trajectory->goal().joint.q[0], models::kHome[0] + 0.1);

  proto::InternalImpedance internal;
  for (int i = 0; i < 6; ++i) internal.add_k_x(i < 3 ? 500 : 50);
  const auto pose = builder_.build(skill_of(pose_motion(0.05, 0, -0.1), internal), now_);
  EXPECT_EQ(pose->mode.generator, fci::MotionGeneratorMode::kCartesianPosition);
  ASSERT_TRUE(pose->settings.cartesian_impedance);
  EXPECT_EQ(pose->settings.cartesian_impedance->K_x[5], 50);
}

TEST_F(SkillBuilderTest, ThresholdsOfAContactAreBelowTheReflexThatTheLabHasSet) {
  fci::SetCollisionBehavior lowered = robot::kCollisionBehavior;
  lowered.upper_force_thresholds_nominal.fill(25);
  builder_ = SkillBuilder(fr3_model(), fr3_limits(), lowered);
  auto skill = skill_of(joint_motion(), proto::JointImpedance());
  proto::Contact contact;
  for (int i = 0; i < 6; ++i) contact.add_force_thresholds(20);
  skill.add_terminations()->PackFrom(contact);
  EXPECT_EQ(error_of(skill), "no error");
  contact.set_force_thresholds(2, 30);
  skill.mutable_terminations(0)->PackFrom(contact);
  EXPECT_EQ(error_of(skill), "Contact: force_thresholds[2] is 30, and should lie within 0 and 25 N");
}

TEST_F(SkillBuilderTest, APostureIsOneThatTheArmCanTakeWhereItCan) {
  proto::CartesianImpedance controller;
  for (int i = 0; i < 7; ++i) controller.add_posture(models::kHome[i] + (i == 2 ? 0.5 : 0));
  auto skill = skill_of(pose_motion(0.05, 0, -0.1), controller);
  EXPECT_EQ(error_of(skill), "no error");
  skill.set_robot_controller(proto::TORQUE_AND_CARTESIAN_POSE);
  EXPECT_TRUE(error_of(skill).ends_with("the robot makes the joints of a pose: use TORQUE")) << error_of(skill);
  controller.set_posture(3, 0.2);
  EXPECT_TRUE(error_of(skill_of(pose_motion(0.05, 0, -0.1), controller)).starts_with("CartesianImpedance: posture[3] is 0.2 rad: expected "));
}

// However near to its goal it begins: what is left of a motion in its first or last cycles may be less than numbers can tell.
TEST_F(SkillBuilderTest, AMotionThatIsThereAlreadyIsBuilt) {
  now_.command.message_id = 1;
  now_.reference.motion = realtime::Channels::kJoint;
  proto::TimeOptimalJoint joints;
  for (const double q : models::kHome) joints.add_q(q);
  proto::TimeOptimalPose pose;
  const Eigen::Isometry3d O_T_EE = realtime::pose(now_.state.O_T_EE);
  for (const double each : O_T_EE.translation()) pose.add_position(each);
  const Eigen::Quaterniond turn(O_T_EE.linear());
  for (const double each : {turn.w(), turn.x(), turn.y(), turn.z()}) pose.add_quaternion(each);
  for (int exponent = 0; exponent <= 20; ++exponent) {
    const double away = exponent == 0 ? 0 : std::pow(10, -exponent);
    now_.reference.joint.q = realtime::Vector7::Map(models::kHome.data()).array() + away;
    now_.reference.joint.dq.setConstant(1e-2 * away);
    now_.reference.joint.ddq.setConstant(1e-4 * away);
    EXPECT_EQ(error_of(skill_of(joints, proto::JointImpedance())), "no error") << away;
    EXPECT_EQ(error_of(skill_of(pose, proto::CartesianImpedance())), "no error") << away;
  }
}

// As of a motion that is asked for in the first cycles of another one from the same place: its speed is rounding.
TEST(PaceAlong, WhatIsOverWithinACycleHasNone) {
  SampledWay way{0, {}, {}};
  for (int k = 0; k <= 100; ++k) {
    way.q.push_back(realtime::Vector7::Constant(k % 2 * 1e-16));
    way.rate.push_back(k == 50 ? 0.5 : 1);
  }
  for (const double duration : {0., 1e-300, 1e-15, 1e-9, 9e-4}) {
    way.duration = duration;
    EXPECT_FALSE(pace_along(way, fr3_limits(), 1)) << duration;
  }
  way.duration = 2e-3;
  const auto pace = pace_along(way, fr3_limits(), std::numeric_limits<double>::infinity());
  ASSERT_TRUE(pace);
  EXPECT_EQ(pace->places.size(), way.q.size());
  EXPECT_NEAR(pace->places.back().time, 4e-3, 1e-6);
}

TEST_F(SkillBuilderTest, MissingPartsAreNamed) {
  proto::Skill skill;
  EXPECT_TRUE(error_of(skill).starts_with("Skill.trajectory is missing: expected one of MinJerkJoint, "));
  skill.mutable_trajectory()->PackFrom(joint_motion());
  EXPECT_TRUE(error_of(skill).starts_with("Skill.controller is missing: expected one of JointImpedance, "));
}

TEST_F(SkillBuilderTest, PartsThatDoNotFitAreRefusedWithThoseThatDo) {
  EXPECT_EQ(error_of(skill_of(joint_motion(), proto::CartesianImpedance())),
            "CartesianImpedance does not take the joint references of MinJerkJoint: use JointImpedance, FreeDrive, "
            "Lqr, PassThrough, PassThroughJointTorque, InternalImpedance, or another trajectory");
  auto skill = skill_of(pose_motion(0, 0, 0.1), proto::JointImpedance());
  skill.set_robot_controller(proto::TORQUE);
  EXPECT_EQ(error_of(skill),
            "the robot controller TORQUE does not fit JointImpedance with the Cartesian references of "
            "RelativeMinJerkPose: use TORQUE_AND_CARTESIAN_POSE, TORQUE_AND_CARTESIAN_VELOCITY");
  skill = skill_of(pose_motion(0, 0, 0.1), proto::CartesianImpedance());
  skill.add_terminations()->PackFrom(proto::FinalJoint());
  EXPECT_TRUE(error_of(skill).starts_with(
      "FinalJoint cannot judge the Cartesian references of RelativeMinJerkPose: use "))
      << error_of(skill);
}

TEST_F(SkillBuilderTest, TheRobotControllerIsTheOneNamedOrElseTheFirstThatFits) {
  using Generator = fci::MotionGeneratorMode;
  using Controller = fci::ControllerMode;
  auto skill = skill_of(pose_motion(0, 0, 0.1), proto::CartesianImpedance());
  EXPECT_EQ(builder_.build(skill, now_)->mode, robot::kTorque);
  skill.set_robot_controller(proto::TORQUE_AND_CARTESIAN_VELOCITY);
  EXPECT_EQ(builder_.build(skill, now_)->mode, (robot::Mode{Controller::kExternal, Generator::kCartesianVelocity}));
  skill = skill_of(pose_motion(0, 0, 0.1), proto::JointImpedance());
  EXPECT_EQ(builder_.build(skill, now_)->mode, (robot::Mode{Controller::kExternal, Generator::kCartesianPosition}));
  skill = skill_of(joint_motion(), proto::InternalImpedance());
  EXPECT_EQ(builder_.build(skill, now_)->mode, (robot::Mode{Controller::kJointImpedance, Generator::kJointPosition}));
}

TEST_F(SkillBuilderTest, SizesAreBounded) {
  auto skill = skill_of(joint_motion(), proto::JointImpedance());
  skill.set_description(std::string(2000, 'x'));
  EXPECT_EQ(error_of(skill), "Skill.description has 2000 bytes: expected at most 1024");
  skill.clear_description();
  for (int i = 0; i < 1000; ++i) skill.add_terminations()->PackFrom(proto::FinalJoint());
  EXPECT_EQ(error_of(skill), "Skill.terminations has 1000 elements: expected at most 16");
}

TEST_F(SkillBuilderTest, JointsOutOfRangeAreRefused) {
  const std::string text = error_of(skill_of(joint_motion(3, 2.4), proto::JointImpedance()));
  EXPECT_TRUE(text.starts_with("MinJerkJoint: q[3] is 0.04")) << text;
}

TEST_F(SkillBuilderTest, RelativeGoalsOutOfRangeAreRefused) {
  proto::RelativeMinJerkJoint message;
  for (int i = 0; i < 7; ++i) message.add_delta_q(i == 3 ? 2.4 : 0);
  const std::string text = error_of(skill_of(message, proto::JointImpedance()));
  EXPECT_TRUE(text.starts_with("RelativeMinJerkJoint: its goal is beyond the arm's range; the nearest is [")) << text;
  message.set_delta_q(3, 0.4);
  EXPECT_EQ(error_of(skill_of(message, proto::JointImpedance())), "no error");
}

// However little: the goal is inside, and a motion that begins fast goes beyond the limit before it turns.
TEST_F(SkillBuilderTest, AWayThatLeavesTheRangeOfAJointIsRefused) {
  const auto skill = skill_of(joint_motion(), proto::JointImpedance());
  now_.command.message_id = 1;
  now_.reference.motion = realtime::Channels::kJoint;
  now_.reference.joint.q = realtime::Vector7::Map(models::kHome.data());
  now_.reference.joint.q[3] = fr3_limits().q_max[3] - 0.01;
  now_.reference.joint.dq[3] = 0.001;
  EXPECT_EQ(error_of(skill), "no error");
  now_.reference.joint.dq[3] = 0.3;
  EXPECT_TRUE(error_of(skill).starts_with("MinJerkJoint: joint 4 would be at ")) << error_of(skill);
}

TEST_F(SkillBuilderTest, PosesOutOfReachAreRefusedWithWhatIsReached) {
  for (const double x : {0.8, 1.9}) {
    const std::string text = error_of(skill_of(pose_motion(x, 0, 0), proto::CartesianImpedance()));
    EXPECT_TRUE(text.starts_with("RelativeMinJerkPose: its goal is out of the arm's reach: position [")) << text;
    EXPECT_NE(text.find("The nearest that the joints allow is ["), std::string::npos) << text;
  }
  EXPECT_EQ(error_of(skill_of(pose_motion(0.2, 0.1, -0.2), proto::CartesianImpedance())), "no error");
}

// Each reached, and not from the one before it nor from home: what would take many seconds is given up.
TEST_F(SkillBuilderTest, PosesThatAreNoPathAreRefusedInTime) {
  const auto model = fr3_model();
  realtime::carry(now_.state, *model);
  std::mt19937 random(1);
  proto::PoseWaypoints waypoints;
  realtime::Vector7 at = Eigen::Map<const realtime::Vector7>(models::kHome.data());
  while (waypoints.position_size() < 3000) {
    realtime::Vector7 q;
    for (int i = 0; i < 7; ++i) q[i] = std::uniform_real_distribution(fr3_limits().q_min[i] + 0.2, fr3_limits().q_max[i] - 0.2)(random);
    const Eigen::Isometry3d pose = model->O_T_EE(q);
    const Reach there = reach(*model, fr3_limits(), pose, at);
    if (!there.reached || (there.tried < 2 && waypoints.position_size() < 900)) continue;
    at = there.q;
    const Eigen::Quaterniond turn(pose.linear());
    for (int i = 0; i < 3; ++i) waypoints.add_position(pose.translation()[i]);
    for (const double each : {turn.w(), turn.x(), turn.y(), turn.z()}) waypoints.add_quaternion(each);
  }
  const std::string text = error_of(skill_of(waypoints, proto::CartesianImpedance()));
  EXPECT_NE(text.find("are far from the one before them"), std::string::npos) << text;
}

// From one side of the base to the other, both reached, straight through the base's axis.
TEST_F(SkillBuilderTest, PathsOutOfReachAreRefused) {
  proto::MinJerkPose behind;
  now_.state.O_T_EE[14] -= 0.3;
  const Eigen::Isometry3d low(Eigen::Map<const Eigen::Matrix4d>(now_.state.O_T_EE.data()));
  const Eigen::Isometry3d goal = Eigen::AngleAxisd(2.6, Eigen::Vector3d::UnitZ()) * low;
  const Eigen::Quaterniond rotation(goal.linear());
  for (int i = 0; i < 3; ++i) behind.add_position(goal.translation()[i]);
  for (double each : {rotation.w(), rotation.x(), rotation.y(), rotation.z()}) behind.add_quaternion(each);
  const std::string text = error_of(skill_of(behind, proto::CartesianImpedance()));
  EXPECT_TRUE(text.starts_with("MinJerkPose: its path, ")) << text;
}

// The robot's own joints could not follow; those that are ours can.
TEST_F(SkillBuilderTest, PosesOfTheRobotsJointsDoNotBeginInASingularPosture) {
  const auto model = fr3_model();
  const realtime::Vector7 q = singular_posture();
  Eigen::Map<realtime::Vector7>(now_.state.q.data()) = q;
  Eigen::Map<Eigen::Matrix4d>(now_.state.O_T_EE.data()) = model->O_T_EE(q).matrix();
  proto::StreamCartesianVelocity stream;
  stream.set_topic("where");
  const std::string text = error_of(skill_of(stream, proto::InternalImpedance()));
  EXPECT_TRUE(text.starts_with("StreamCartesianVelocity: the arm is in a singular posture, [-0.2657, ")) << text;
  EXPECT_EQ(error_of(skill_of(stream, proto::CartesianImpedance())), "no error");
}

// Towards goals in all directions, much faster than the joints may: as fast as they may then, on the same way, smoothly.
TEST_F(SkillBuilderTest, AFarPoseIsPacedByItsJoints) {
  const auto model = fr3_model();
  realtime::carry(now_.state, *model);
  std::mt19937 random(3);
  std::uniform_real_distribution<> side(-0.25, 0.25);
  int driven = 0, paced = 0;
  for (int trial = 0; trial < 40; ++trial) {
    auto motion = pose_motion(side(random), 2 * side(random), side(random));
    motion.set_duration(0.3);
    std::unique_ptr<realtime::Skill> skill;
    try {
      skill = builder_.build(skill_of(motion, proto::CartesianImpedance()), now_);
    } catch (const Refused&) {
      continue;
    }
    ++driven;
    realtime::TrajectoryGenerator& way = *skill->trajectory;
    paced += dynamic_cast<const realtime::Paced*>(&way) != nullptr;
    constexpr double kTick = 0.001;
    realtime::PoseJoints joints(*model, fr3_limits());
    joints.place(Eigen::Map<const realtime::Vector7>(models::kHome.data()));
    realtime::Reference reference, goal = way.goal();
    way.step(at_home(), 0, reference);
    const realtime::Vector3 start = reference.cartesian.position, straight = goal.cartesian.position - start;
    std::vector<realtime::Vector7> q;
    realtime::Reference before = reference;
    for (double time = 0; time < way.duration() + 0.01; time += kTick, before = reference) {
      way.step(at_home(), time, reference);
      for (int n = 0; n < 3; ++n) joints.step(reference.cartesian, kTick / 3);
      q.push_back(joints.joints().q);
      const realtime::CartesianReference &now = reference.cartesian, &last = before.cartesian;
      const realtime::Vector3 here = now.position - start;
      ASSERT_LT((here - here.dot(straight) / straight.squaredNorm() * straight).norm(), 1e-6);
      if (time == 0) continue;
      const realtime::Vector6 v = (now.velocity + last.velocity) / 2, dv = (now.velocity - last.velocity) / kTick;
      ASSERT_LT(((now.position - last.position) / kTick - v.head<3>()).norm(), 1e-3) << time;
      ASSERT_LT((dv - (now.acceleration + last.acceleration) / 2).head<3>().norm(), 0.1) << time;
    }
    EXPECT_TRUE(reference.cartesian.position == goal.cartesian.position);
    double velocity = 0, acceleration = 0, jerk = 0;
    for (std::size_t k = 3; k < q.size(); ++k) {
      for (int i = 0; i < 7; ++i) {
        const double v[] = {q[k][i] - q[k - 1][i], q[k - 1][i] - q[k - 2][i], q[k - 2][i] - q[k - 3][i]};
        velocity = std::max(velocity, std::abs(v[0]) / kTick / fr3_limits().dq_max[i]);
        acceleration = std::max(acceleration, std::abs(v[0] - v[1]) / (kTick * kTick) / fr3_limits().ddq_max[i]);
        jerk = std::max(jerk, std::abs(v[0] - 2 * v[1] + v[2]) / std::pow(kTick, 3) / fr3_limits().dddq_max[i]);
      }
    }
    EXPECT_LT(velocity, 0.9) << motion.DebugString();
    EXPECT_LT(acceleration, 1) << motion.DebugString();
    EXPECT_LT(jerk, 0.8) << motion.DebugString();
    EXPECT_GT(std::max({velocity, acceleration, jerk}), 0.4) << motion.DebugString();  // and not slower for nothing
    EXPECT_GE(way.stretch(), 1);
  }
  EXPECT_GT(driven, 20);
  EXPECT_GT(paced, driven / 2);
}

TEST_F(SkillBuilderTest, AGentlePoseIsNotPaced) {
  auto motion = pose_motion(0.05, 0.1, -0.1);
  motion.set_duration(2);
  const auto skill = builder_.build(skill_of(motion, proto::CartesianImpedance()), now_);
  EXPECT_EQ(skill->trajectory->duration(), 2);
  EXPECT_EQ(skill->trajectory->stretch(), 1);
}

TEST_F(SkillBuilderTest, ARelativeGoalCountsFromTheReferenceThatIsCommanded) {
  auto skill = builder_.build(skill_of(pose_motion(0, 0, 0.1), proto::CartesianImpedance()), now_);
  const double z = now_.state.O_T_EE[14];
  EXPECT_NEAR(skill->trajectory->goal().cartesian.position.z(), z + 0.1, 1e-9);

  now_.command.message_id = 1;
  now_.reference.motion = realtime::Channels::kPose;
  now_.reference.cartesian.position = Eigen::Map<const Eigen::Vector3d>(&now_.state.O_T_EE[12]) - 0.05 * Eigen::Vector3d::UnitZ();
  now_.reference.cartesian.orientation =
      Eigen::Quaterniond(Eigen::Matrix4d::Map(now_.state.O_T_EE.data()).topLeftCorner<3, 3>());
  skill = builder_.build(skill_of(pose_motion(0, 0, 0.1), proto::CartesianImpedance()), now_);
  EXPECT_NEAR(skill->trajectory->goal().cartesian.position.z(), z + 0.05, 1e-9);
}

}  // namespace
}  // namespace server
