// Modes of the robot that people and errors bring about, and how stiff it is in them.

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "sim/robot/rotation.hpp"
#include "tests/sim/robot_rig.hpp"

namespace sim {
namespace {

using fci::ControllerMode;
using fci::Error;
using fci::RobotMode;
using fci::Status;
using Mode = fci::MotionGeneratorMode;

class BehaviourOf : public testing::TestWithParam<const char*> {
 protected:
  RobotRig rig{as_delivered(GetParam())};

  Eigen::Vector3d tcp() const { return Eigen::Matrix4d(rig.world.truth().O_T_TCP.data()).topRightCorner<3, 1>(); }
  Eigen::Matrix3d axes() const { return Eigen::Matrix4d(rig.world.truth().O_T_TCP.data()).topLeftCorner<3, 3>(); }
  void move_fast() {
    ASSERT_EQ(rig.start(Mode::kJointVelocity, ControllerMode::kJointImpedance), Status::kMotionStarted);
    fci::RobotCommand command;
    for (int i = 1; i <= 200; ++i) {
      command.dq_c[0] = 0.5 * ArmRig::minimum_jerk(i / 200.);
      rig.cycle(command);
    }
    ASSERT_TRUE(rig.robot.moving());
  }
  // Everything that wants an idle robot.
  void expect_refused(Status status) {
    EXPECT_EQ(rig.robot.start({}), status);
    EXPECT_EQ(rig.robot.set(fci::SetJointImpedance{}), status);
    EXPECT_EQ(rig.robot.set(fci::SetCartesianImpedance{{10, 10, 10, 1, 1, 1}}), status);
    EXPECT_EQ(rig.robot.set(fci::SetCollisionBehavior{}), status);
    EXPECT_EQ(rig.robot.set(fci::SetGuidingMode{}), status);
    EXPECT_EQ(rig.robot.set(fci::SetEEToK{}), status);
    EXPECT_EQ(rig.robot.set(fci::SetNEToEE{}), status);
    EXPECT_EQ(rig.robot.set(fci::SetLoad{}), status);
    EXPECT_EQ(rig.robot.set(fci::SetFilters{}), status);
  }
};
INSTANTIATE_TEST_SUITE_P(Arms, BehaviourOf, testing::Values("fer", "fr3"),
                         [](const auto& info) { return std::string(info.param); });

// --- where a motion begins -------------------------------------------------------------------------------------------

// As libfranka's examples do since 0.15: from what is measured, and from there on as far beside it as may be.
TEST(Behaviour, MotionsBeginAtWhatIsMeasuredFromVersion9On) {
  struct Beside {
    double angle = 0, height = 0;  // rad of a joint and of the elbow, m of the pose
  };
  for (fci::Version version = 5; version <= 10; ++version) {
    RobotRig rig(as_delivered(version == 5 ? "fer" : "fr3"));
    rig.robot.set_version(version);
    ASSERT_EQ(rig.robot.set(thresholds(1000, 1000)), Status::kSuccess);
    const auto ends_well = [&](Mode generator, ControllerMode controller, double way, std::optional<Beside> beside = {}) {
      EXPECT_EQ(rig.start(generator, controller), Status::kMotionStarted);
      const fci::RobotState begin = rig.state();
      constexpr int kCycles = 1000;
      for (int i = 0; i <= kCycles && rig.robot.moving(); ++i) {
        fci::RobotCommand command;
        command.valid_elbow = true;
        command.q_c = beside ? begin.q_d : begin.q;
        command.O_T_EE_c = beside ? begin.O_T_EE_c : begin.O_T_EE;
        command.elbow_c = beside ? begin.elbow_c : begin.elbow;
        const double done = way * ArmRig::minimum_jerk(double(i) / kCycles);
        const Beside by = beside.value_or(Beside{});
        command.q_c[3] += by.angle + done;
        command.O_T_EE_c[14] += by.height + done;
        command.elbow_c[0] += by.angle + done;
        command.motion_generation_finished = i == kCycles;
        rig.cycle(command);
        if (i == 0 && version >= 9 && rig.robot.moving()) {
          EXPECT_EQ(reported(rig.state().dq_d), Joints::Zero());
          if (generator == Mode::kJointPosition) {
            EXPECT_EQ(rig.state().q_d, command.q_c);
          } else {
            EXPECT_EQ(rig.state().O_T_EE_c, command.O_T_EE_c);
            EXPECT_NEAR(rig.state().elbow_d[0], command.elbow_c[0], 1e-9);
          }
        }
      }
      const bool well = rig.robot.outcome() == Status::kSuccess;
      EXPECT_NE(well, fci::any(rig.state().errors));
      EXPECT_EQ(rig.robot.recover(), Status::kSuccess);
      rig.wait(0.1);
      return well;
    };
    for (const auto generator : {Mode::kJointPosition, Mode::kCartesianPosition}) {
      for (const auto controller : {ControllerMode::kJointImpedance, ControllerMode::kCartesianImpedance}) {
        SCOPED_TRACE(testing::Message() << "version " << version << ", modes " << int(generator) << " " << int(controller));
        for (const double way : {0.1, -0.1, 0.1, -0.1}) EXPECT_EQ(ends_well(generator, controller, way), version >= 9);
        EXPECT_TRUE(ends_well(generator, controller, 0.1, Beside{}));
        EXPECT_EQ(ends_well(generator, controller, -0.1, Beside{0.0049, 0.0019}), version >= 9);
        EXPECT_FALSE(ends_well(generator, controller, 0, Beside{0.0051, 0.0021}));
        EXPECT_FALSE(ends_well(generator, controller, 0, Beside{0.01, 0.01}));
      }
    }
  }
}

// --- impedance -------------------------------------------------------------------------------------------------------

TEST_P(BehaviourOf, JointsYieldByTheStiffnessThatWasSet) {
  ASSERT_EQ(rig.robot.set(thresholds(1000, 1000)), Status::kSuccess);
  const fci::Vector7 K = {900, 800, 700, 600, 500, 400, 300};
  for (const double scale : {1., 3.}) {
    fci::SetJointImpedance request;
    for (int i = 0; i < 7; ++i) request.K_theta[i] = scale * K[i];
    ASSERT_EQ(rig.robot.set(request), Status::kSuccess);
    // A motion that stays: its impedance is the one that holds afterwards as well.
    ASSERT_EQ(rig.start(Mode::kJointPosition, ControllerMode::kJointImpedance), Status::kMotionStarted);
    const auto hold = rig.hold();
    const Wrench push = (Wrench() << 12, -10, 14, 0.5, -0.3, 0.8).finished();
    rig.push(push);
    for (int i = 0; i < 2500; ++i) rig.cycle(hold);
    ArmModel model(rig.arm);
    model.update_kinematics(rig.q());
    const Joints torque = model.jacobian({0, 0, models::hand::kTcp}).transpose() * push;
    for (int i = 0; i < 7; ++i) {
      // Friction bears up to 0.2 N m of it.
      EXPECT_NEAR(request.K_theta[i] * (rig.q()[i] - hold.q_c[i]), torque[i], 0.25) << "joint " << i + 1;
    }
    rig.push(Wrench::Zero());
    for (int i = 0; i < 1000; ++i) rig.cycle(hold);
    auto last = hold;
    last.motion_generation_finished = true;
    rig.cycle(last);
    ASSERT_EQ(rig.robot.outcome(), Status::kSuccess);
  }
}

TEST_P(BehaviourOf, TheToolYieldsByTheStiffnessThatWasSet) {
  ASSERT_EQ(rig.robot.set(thresholds(1000, 1000)), Status::kSuccess);
  const Eigen::Matrix4d EE_T_K = transform({0, 0, 0.05}, 0.7, {0, 0, 1});
  ASSERT_EQ(rig.robot.set(fci::SetEEToK{wire(EE_T_K)}), Status::kSuccess);
  const fci::SetCartesianImpedance request{{400, 800, 1600, 40, 60, 80}};
  ASSERT_EQ(rig.robot.set(request), Status::kSuccess);
  ASSERT_EQ(rig.start(Mode::kCartesianPosition, ControllerMode::kCartesianImpedance), Status::kMotionStarted);
  const auto hold = rig.hold();
  for (int i = 0; i < 500; ++i) rig.cycle(hold);
  const auto O_T_K = [&] {
    return Eigen::Matrix4d(Eigen::Matrix4d(rig.world.truth().O_T_TCP.data()) * EE_T_K);
  };
  const Eigen::Matrix4d before = O_T_K();
  const Eigen::Matrix3d R = before.topLeftCorner<3, 3>();
  const Eigen::Vector3d K_F(6, -10, 14);
  for (const bool pushed : {true, false}) {
    // At the origin of K: the world pushes at the tool centre.
    Wrench push = Wrench::Zero();
    if (pushed) {
      push.head<3>() = R * K_F;
      push.tail<3>() = (before.topRightCorner<3, 1>() - tcp()).cross(push.head<3>());
    }
    rig.push(push);
    for (int i = 0; i < 3000; ++i) rig.cycle(hold);
    const Eigen::Vector3d moved = R.transpose() * (O_T_K() - before).topRightCorner<3, 1>();
    for (int i = 0; i < 3; ++i) {
      EXPECT_NEAR(moved[i] * request.K_x[i], pushed ? K_F[i] : 0, 1.5) << "axis " << i;  // of friction
    }
  }
}

// With friction and noise.
TEST_P(BehaviourOf, MotionsEndWhereTheyShould) {
  for (const auto controller : {ControllerMode::kJointImpedance, ControllerMode::kCartesianImpedance}) {
    ASSERT_EQ(rig.start(Mode::kJointPosition, controller), Status::kMotionStarted);
    const Joints from = reported(rig.state().q_d);
    const Joints way = 0.3 * (Joints() << 1, -1, 1, 1, -1, 1, -1).finished();
    fci::RobotCommand command;
    for (int i = 1; i <= 1800; ++i) {
      command.q_c = array(from + ArmRig::minimum_jerk(std::min(1., i / 1500.)) * way);
      rig.cycle(command);
    }
    if (controller == ControllerMode::kJointImpedance) {
      EXPECT_LT((rig.q() - joints(command.q_c)).cwiseAbs().maxCoeff(), 1e-3);
    }
    const Eigen::Matrix4d goal = reported(rig.state().O_T_EE_d);
    const Eigen::Matrix4d reached(rig.world.truth().O_T_TCP.data());
    EXPECT_LT(distance(goal, reached), 0.005);
    EXPECT_LT(angle(goal, reached), M_PI / 180);
    command.motion_generation_finished = true;
    rig.cycle(command);
    ASSERT_EQ(rig.robot.outcome(), Status::kSuccess);
  }
}

// --- the user stop ---------------------------------------------------------------------------------------------------

TEST_P(BehaviourOf, TheUserStopEndsAMotionAndRefusesOthersUntilItIsLetGo) {
  for (const fci::Version version : {5, 10}) {
    rig.robot.set_version(version);
    move_fast();
    rig.robot.user_stop(true);
    rig.cycle();
    EXPECT_EQ(rig.state().robot_mode, RobotMode::kUserStopped);
    EXPECT_EQ(rig.state().motion_generator_mode, Mode::kIdle);
    EXPECT_EQ(rig.robot.outcome(), Status::kEmergencyAborted);
    EXPECT_FALSE(fci::any(rig.state().errors));
    EXPECT_GT(reported(rig.state().dq).norm(), 0.2);  // it brakes, and does not stop dead
    rig.wait(0.3);
    EXPECT_LT(reported(rig.state().dq).norm(), 0.02);
    EXPECT_EQ(reported(rig.state().ddq_d).norm(), 0);  // and is held, without a torque that would accelerate it
    expect_refused(Status::kNotPossible);
    EXPECT_EQ(rig.robot.recover(), Status::kNotPossible);
    const Joints stopped = rig.q();
    rig.wait(0.5);
    EXPECT_LT((rig.q() - stopped).norm(), 1e-3);
    rig.robot.user_stop(false);
    rig.cycle();
    EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
    EXPECT_EQ(rig.robot.set(fci::SetLoad{}), Status::kSuccess);
  }
}

TEST_P(BehaviourOf, LettingTheUserStopGoResetsErrors) {
  rig.robot.inject(Error::kPowerLimit);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kReflex);
  rig.robot.user_stop(true);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kUserStopped);
  EXPECT_TRUE(fci::any(rig.state().errors));
  rig.robot.user_stop(false);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
  EXPECT_FALSE(fci::any(rig.state().errors));
}

TEST_P(BehaviourOf, TheUserStopInterruptsARecovery) {
  rig.robot.inject(Error::kJointReflex);
  rig.cycle();
  EXPECT_EQ(rig.robot.recover(), Status::kSuccess);
  rig.wait(0.01);
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kAutomaticErrorRecovery);
  expect_refused(Status::kNotPossible);
  rig.robot.user_stop(true);
  rig.cycle();
  EXPECT_FALSE(rig.robot.recovering());
  EXPECT_EQ(rig.robot.recovered(), Status::kEmergencyAborted);
}

TEST_P(BehaviourOf, TheEnablingDeviceIsASafetyFunctionFromVersion6On) {
  for (const fci::Version version : {5, 6, 10}) {
    rig.robot.set_version(version);
    move_fast();
    rig.robot.enabling_device(false);
    rig.cycle();
    EXPECT_EQ(rig.state().robot_mode, RobotMode::kUserStopped);
    EXPECT_EQ(rig.robot.outcome(),
              version == 5 ? Status::kEmergencyAborted : Status::kPreemptedDueToActivatedSafetyFunctions);
    const Status refusal = version == 5 ? Status::kNotPossible : Status::kRejectedDueToActivatedSafetyFunctions;
    expect_refused(refusal);
    EXPECT_EQ(rig.robot.recover(), refusal);
    rig.robot.enabling_device(true);
    rig.wait(0.3);
    EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
  }
}

TEST_P(BehaviourOf, RecoveryInIdleResetsCollisions) {
  rig.robot.enabling_device(false);
  rig.push((Wrench() << 0, 0, -60, 0, 0, 0).finished());
  rig.wait(0.5);
  rig.push(Wrench::Zero());
  rig.wait(0.5);
  rig.robot.enabling_device(true);
  rig.wait(0.1);
  ASSERT_EQ(rig.state().robot_mode, RobotMode::kIdle);
  ASSERT_EQ(rig.state().cartesian_collision[2], 1);
  EXPECT_EQ(rig.robot.recover(), Status::kSuccess);
  rig.cycle();
  EXPECT_EQ(rig.state().cartesian_collision, fci::Vector6{});
  EXPECT_EQ(rig.state().joint_collision, fci::Vector7{});
}

TEST_P(BehaviourOf, WithItsJointsLockedTheRobotTakesNothing) {
  rig.robot.lock(true);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kOther);
  expect_refused(Status::kNotPossible);
  rig.robot.guide(true);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kOther);
  rig.robot.lock(false);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
  move_fast();
  rig.robot.lock(true);
  rig.cycle({.dq_c = {0.5}});
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kMove);
}

// --- walls that are set up at the robot ------------------------------------------------------------------------------

TEST_P(BehaviourOf, NoMotionLeadsIntoAVirtualWall) {
  const auto tool = [&] { return rig.world.truth().O_T_TCP[13]; };  // y, which the first joint moves
  // Whether the arm gets a radian on by the first joint at this velocity (rad/s), within 3 s.
  const auto turns = [&](double velocity) {
    EXPECT_EQ(rig.start(Mode::kJointVelocity, ControllerMode::kJointImpedance), Status::kMotionStarted);
    const double from = rig.q()[0];
    fci::RobotCommand command;
    for (int i = 1; i <= 3000 && !rig.robot.outcome(); ++i) {
      const bool there = std::abs(rig.q()[0] - from) > 1;
      command.dq_c[0] += std::clamp((there ? 0 : velocity) - command.dq_c[0], -0.002, 0.002);
      if (there && command.dq_c[0] == 0) command.motion_generation_finished = true;
      rig.cycle(command);
    }
    rig.wait(0.5);
    return rig.robot.outcome() == Status::kSuccess;
  };
  VirtualWall wall{{1, 1, 1}, Eigen::Isometry3d::Identity(), true};
  wall.frame.translate(Eigen::Vector3d(0, 0.25, 0));
  rig.robot.set_virtual_wall(3, wall);
  EXPECT_FALSE(rig.robot.virtual_wall(2).active);
  EXPECT_EQ(rig.robot.virtual_wall(3).size, wall.size);

  EXPECT_FALSE(turns(0.5));
  EXPECT_EQ(rig.robot.outcome(), Status::kReflexAborted);
  EXPECT_EQ(fci::names(rig.state().errors), "cartesian_position_limits_violation");
  EXPECT_GT(tool(), 0.1);
  EXPECT_LT(tool(), 0.25) << "the hand is wide";
  EXPECT_EQ(rig.robot.recover(), Status::kSuccess);
  rig.wait(1);
  EXPECT_FALSE(turns(0.5)) << "it is in the wall still";
  EXPECT_EQ(rig.robot.recover(), Status::kSuccess);
  rig.wait(1);
  EXPECT_TRUE(turns(-0.5)) << "the way out is open";

  wall.active = false;
  rig.robot.set_virtual_wall(3, wall);
  EXPECT_TRUE(turns(0.5));
  EXPECT_TRUE(turns(0.5));
  EXPECT_GT(tool(), 0.26);
}

// --- errors ----------------------------------------------------------------------------------------------------------

TEST_P(BehaviourOf, EveryErrorCanBeInjectedAndRecoveredFrom) {
  for (std::size_t i = 0; i < fci::kErrorCount; ++i) {
    if (i % 8 == 0) {
      move_fast();
    }
    const bool moving = rig.robot.moving();
    rig.robot.inject(static_cast<Error>(i));
    rig.cycle();
    EXPECT_EQ(rig.state().robot_mode, RobotMode::kReflex);
    for (std::size_t j = 0; j < fci::kErrorCount; ++j) EXPECT_EQ(rig.state().errors[j], i == j);
    EXPECT_EQ(rig.state().reflex_reason, rig.state().errors);
    if (moving) {
      EXPECT_EQ(rig.robot.outcome(), Status::kReflexAborted);
    }
    expect_refused(Status::kNotPossible);
    EXPECT_EQ(rig.robot.recover(), Status::kSuccess);
    rig.wait(0.2);
    EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
    EXPECT_FALSE(fci::any(rig.state().errors));
  }
}

TEST(Behaviour, AnArmBeyondItsRangeHasToBeBroughtBackByHand) {
  World::Options options = as_delivered("fr3");
  options.q[0] = models::limits(*options.arm, 10).q_max[0] - 0.01;
  RobotRig rig(options);
  ASSERT_EQ(rig.robot.set(fci::SetJointImpedance{{30, 3000, 3000, 2500, 2500, 2000, 2000}}), Status::kSuccess);
  rig.robot.inject(Error::kJointPositionLimits);
  const auto pull = [&](double sign) {  // about the first joint
    const Eigen::Matrix4d T(rig.world.truth().O_T_TCP.data());
    rig.push(sign * (Wrench() << -T(1, 3), T(0, 3), 0, 0, 0, 0).finished() * 40);
  };
  pull(0.3);
  rig.wait(0.5);
  EXPECT_GT(rig.q()[0], models::limits(*options.arm, 10).q_max[0] + 0.01);
  EXPECT_EQ(rig.robot.recover(), Status::kManualErrorRecoveryRequired);
  rig.robot.user_stop(true);
  rig.cycle();
  rig.robot.user_stop(false);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kReflex);

  rig.robot.user_stop(true);
  rig.cycle();
  rig.robot.guide(true);
  rig.cycle();
  ASSERT_EQ(rig.state().robot_mode, RobotMode::kGuiding);
  pull(0.5);
  rig.wait(0.1);
  EXPECT_TRUE(rig.state().errors[static_cast<std::size_t>(Error::kJointMoveInWrongDirection)]);
  pull(-0.7);
  rig.wait(0.4);
  rig.push(Wrench::Zero());
  rig.wait(1);
  rig.robot.guide(false);
  rig.robot.user_stop(false);
  rig.wait(0.1);
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
  EXPECT_FALSE(fci::any(rig.state().errors));
}

// --- what it carries -------------------------------------------------------------------------------------------------

// Finite numbers as well: of the largest, what the robot would compute is not.
TEST_P(BehaviourOf, LoadsAndFramesThatNoArmHasAreRefused) {
  for (const double much : {101., 2.6e207, 1e308}) {
    for (const double value : {much, -much}) {
      SCOPED_TRACE(value);
      fci::Pose far = fci::kIdentityPose;
      far[13] = value;
      EXPECT_EQ(rig.robot.set(fci::SetNEToEE{far}), Status::kInvalidArgument);
      EXPECT_EQ(rig.robot.set(fci::SetEEToK{far}), Status::kInvalidArgument);
      EXPECT_EQ(rig.robot.set(fci::SetLoad{value, {}, {}}), Status::kInvalidArgument);
      EXPECT_EQ(rig.robot.set(fci::SetLoad{0.5, {value, 0, 0}, {}}), Status::kInvalidArgument);
      EXPECT_EQ(rig.robot.set(fci::SetLoad{0.5, {}, {value, 0, 0, 0, 1, 0, 0, 0, 1}}), Status::kInvalidArgument);
    }
  }
  rig.wait(0.1);
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
  EXPECT_TRUE(reported(rig.state().tau_J).allFinite());
}

TEST_P(BehaviourOf, TheMostThatIsTakenLeavesEverythingANumber) {
  const fci::Pose far = wire(transform({2, -2, 2}, 0.5, {1, 2, 3}));
  ASSERT_EQ(rig.robot.set(thresholds(1e6, 1e6)), Status::kSuccess);
  ASSERT_EQ(rig.robot.set(fci::SetNEToEE{far}), Status::kSuccess);
  ASSERT_EQ(rig.robot.set(fci::SetEEToK{far}), Status::kSuccess);
  ASSERT_EQ(rig.robot.set(fci::SetLoad{20, {-2, 2, 2}, {100, 0, 0, 0, 100, 0, 0, 0, 100}}), Status::kSuccess);
  for (const auto controller : {ControllerMode::kJointImpedance, ControllerMode::kCartesianImpedance}) {
    // Whatever error ends it, the law goes on.
    ASSERT_EQ(rig.start(Mode::kJointPosition, controller), Status::kMotionStarted);
    const auto hold = rig.hold();
    for (int i = 0; i < 500; ++i) {
      rig.cycle(hold);
      const auto& s = rig.state();
      for (const auto& values : {s.q, s.dq, s.tau_J, s.tau_J_d, s.tau_ext_hat_filtered}) {
        ASSERT_TRUE(reported(values).allFinite()) << "cycle " << i;
      }
      ASSERT_TRUE(reported(s.O_F_ext_hat_K).allFinite() && reported(s.K_F_ext_hat_K).allFinite()) << "cycle " << i;
    }
    rig.robot.recover();
    rig.wait(1);  // at rest, recovered
  }
}

// --- guiding ---------------------------------------------------------------------------------------------------------

TEST_P(BehaviourOf, GuidingTakesThePressedUserStop) {
  rig.robot.guide(true);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
  rig.robot.user_stop(true);
  rig.cycle();
  rig.robot.guide(true);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kGuiding);
  expect_refused(Status::kNotPossible);
  EXPECT_EQ(rig.robot.recover(), Status::kNotPossible);
  rig.robot.guide(false);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kUserStopped);
  rig.robot.user_stop(false);
  rig.cycle();
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
}

TEST_P(BehaviourOf, AGuidedArmIsWeightlessAndFreeAlongTheAxesThatAreUnlocked) {
  struct Case {
    std::array<bool, 6> axes;
    int pushed;  // axis of O
  };
  for (const Case& guided : {Case{{true, true, true, true, true, true}, 1},
                             {{false, true, false, false, false, false}, 1},
                             {{true, false, true, true, true, true}, 1},
                             {{false, false, true, false, false, false}, 2},
                             {{false, false, false, false, false, true}, 5},
                             {{true, true, true, false, false, false}, 5}}) {
    RobotRig rig(as_delivered(GetParam()));
    ASSERT_EQ(rig.robot.set(fci::SetGuidingMode{guided.axes, true}), Status::kSuccess);
    rig.robot.user_stop(true);
    rig.cycle();
    rig.robot.guide(true);
    const Eigen::Matrix4d before(rig.world.truth().O_T_TCP.data());
    rig.wait(1);
    EXPECT_LT(distance(Eigen::Matrix4d(rig.world.truth().O_T_TCP.data()), before), 1e-3);  // weightless
    rig.push((guided.pushed < 3 ? 12 : 1.5) * Wrench::Unit(guided.pushed));
    rig.wait(0.8);
    const Eigen::Matrix4d after(rig.world.truth().O_T_TCP.data());
    Wrench moved;
    moved.head<3>() = (after - before).topRightCorner<3, 1>();
    moved.tail<3>() = rotation_between(before.topLeftCorner<3, 3>(), after.topLeftCorner<3, 3>());
    for (int i = 0; i < 6; ++i) {
      const double bound = i < 3 ? 0.012 : 0.03;
      if (!guided.axes[i]) {
        EXPECT_LT(std::abs(moved[i]), bound) << "locked axis " << i << ", pushed " << guided.pushed;
      } else if (i == guided.pushed) {
        EXPECT_GT(moved[i], 3 * bound);
      }
    }
    EXPECT_EQ(rig.state().robot_mode, RobotMode::kGuiding);
    // It stays where it was led.
    rig.push(Wrench::Zero());
    rig.robot.guide(false);
    rig.robot.user_stop(false);
    rig.wait(0.5);
    EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
    const Eigen::Matrix4d left(rig.world.truth().O_T_TCP.data());
    rig.wait(0.5);
    EXPECT_LT(distance(Eigen::Matrix4d(rig.world.truth().O_T_TCP.data()), left), 1e-3);
  }
}

// A hand that is held leaves the arm one motion, that of its elbow.
TEST_P(BehaviourOf, TheElbowIsLockedOrFreeByItself) {
  ArmModel model(rig.arm);
  const Joints q = joints(models::kHome);
  model.update(q, Joints::Zero());
  const Eigen::Matrix4d F_T_EE = F_T_hand_TCP();
  const Joints elbow =
      Eigen::FullPivLU<ArmModel::Matrix67>(model.jacobian(F_T_EE.topRightCorner<3, 1>())).kernel().col(0).normalized();
  for (const bool free : {true, false}) {
    Guiding guiding;
    model.update(q, Joints::Zero());
    guiding.start({{}, free}, model, F_T_EE, q);
    const Joints moved = q + 0.05 * elbow;
    model.update(moved, Joints::Zero());
    const double back = -elbow.dot(guiding.torque(model, F_T_EE, moved, Joints::Zero()));
    if (free) {
      EXPECT_LT(std::abs(back), 0.1);
    } else {
      EXPECT_GT(back, 0.5);
    }
  }
}

}  // namespace
}  // namespace sim
