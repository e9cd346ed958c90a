// What the robot feels of its surroundings, and what it does about it.

#include <gtest/gtest.h>

#include "sim/robot/joint_figures.hpp"
#include "tests/sim/robot_rig.hpp"
#include "tests/sim/scene_file.hpp"

namespace sim {
namespace {

using fci::ControllerMode;
using fci::Error;
using fci::RobotMode;
using fci::Status;
using Mode = fci::MotionGeneratorMode;

bool raised(const fci::RobotState& state, Error error) { return state.errors[static_cast<std::size_t>(error)]; }

class ContactOf : public testing::TestWithParam<const char*> {
 protected:
  // A posture with the hand above the floor, and not stretched out.
  Joints posture(std::mt19937& random) {
    const models::Limits& limits = models::limits(models::arm(GetParam()), 5);
    ArmModel model(models::arm(GetParam()));
    for (;;) {
      Joints q;
      for (int i = 0; i < 7; ++i) {
        const double way = limits.q_max[i] - limits.q_min[i];
        q[i] = std::uniform_real_distribution(limits.q_min[i] + 0.15 * way, limits.q_max[i] - 0.15 * way)(random);
      }
      model.update_kinematics(q);
      const auto J = model.jacobian({0, 0, models::hand::kTcp});
      if (model.O_T_F()(2, 3) > 0.35 && (J * J.transpose()).determinant() > 1e-4) return q;
    }
  }
};
INSTANTIATE_TEST_SUITE_P(Arms, ContactOf, testing::Values("fer", "fr3"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(ContactOf, EstimatesWhatPushes) {
  std::mt19937 random(7);
  std::normal_distribution<> normal;
  for (int trial = 0; trial < 10; ++trial) {
    World::Options options = as_delivered(GetParam());
    options.q = array(posture(random));
    RobotRig rig(options);
    ASSERT_EQ(rig.robot.set(thresholds(1000, 1000)), Status::kSuccess);
    // Every other time with frames and with a load, which is not there: its missing weight is felt as well.
    const bool configured = trial % 2;
    const double m_load = configured ? 0.6 : 0;
    const Eigen::Vector3d F_x_Cload(0.02, -0.01, 0.12);
    if (configured) {
      const Eigen::Matrix4d NE_T_EE = transform({0.01, 0.02, 0.05}, 0.6, {1, 2, 3});
      const Eigen::Matrix4d EE_T_K = transform({-0.03, 0, 0.04}, -0.8, {2, 0, 1});
      ASSERT_EQ(rig.robot.set(fci::SetNEToEE{wire(NE_T_EE)}), Status::kSuccess);
      ASSERT_EQ(rig.robot.set(fci::SetEEToK{wire(EE_T_K)}), Status::kSuccess);
      ASSERT_EQ(rig.robot.set(fci::SetLoad{m_load, {0.02, -0.01, 0.12}, {}}), Status::kSuccess);
    }
    Wrench push;
    for (double& x : push) x = normal(random);
    push.head<3>() *= 15 / push.head<3>().norm();
    push.tail<3>() *= 1 / push.tail<3>().norm();
    rig.push(push);
    rig.wait(1.5);

    // The same at K, in the axes of O: the push at the tool centre, and what holds up a load that weighs nothing.
    const fci::RobotState& state = rig.state();
    const Eigen::Matrix4d O_T_K = reported(state.O_T_EE) * reported(state.EE_T_K);
    const Eigen::Vector3d O_K = O_T_K.topRightCorner<3, 1>();
    const Eigen::Vector3d TCP = Eigen::Matrix4d(rig.world.truth().O_T_TCP.data()).topRightCorner<3, 1>();
    const Eigen::Matrix4d O_T_F = reported(state.O_T_EE) * reported(state.F_T_EE).inverse();
    const Eigen::Vector3d load = (O_T_F * F_x_Cload.homogeneous()).head<3>();
    const Eigen::Vector3d weight(0, 0, -9.81 * m_load);
    Wrench felt = -push;
    felt.tail<3>() -= (TCP - O_K).cross(push.head<3>());
    felt.head<3>() += weight;
    felt.tail<3>() += (load - O_K).cross(weight);
    const Wrench O_F = reported(state.O_F_ext_hat_K), K_F = reported(state.K_F_ext_hat_K);
    EXPECT_LT((O_F - felt).head<3>().norm(), 1 + 0.05 * push.head<3>().norm()) << "posture " << trial;
    EXPECT_LT((O_F - felt).tail<3>().norm(), 0.2 + 0.05 * felt.tail<3>().norm()) << "posture " << trial;
    const Eigen::Matrix3d R = O_T_K.topLeftCorner<3, 3>();
    EXPECT_LT((R * K_F.head<3>() - O_F.head<3>()).norm(), 1e-3);
    EXPECT_LT((R * K_F.tail<3>() - O_F.tail<3>()).norm(), 1e-3);
  }
}

// As long as a minimum jerk motion from one posture to the other takes that stays just inside the limits, s.
double shortest(const models::Limits& limits, const Joints& from, const Joints& to) {
  double seconds = 0.1;
  for (int i = 0; i < 7; ++i) {
    const double way = std::abs(to[i] - from[i]);
    const double dq =
        std::min(limits.dq_upper(i, std::max(from[i], to[i])), -limits.dq_lower(i, std::min(from[i], to[i])));
    seconds = std::max({seconds, 1.875 * way / (0.95 * dq), std::sqrt(5.774 * way / (0.95 * limits.ddq_max[i])),
                        std::cbrt(60 * way / (0.95 * limits.dddq_max[i]))});
  }
  return seconds;
}

// With the thresholds of a robot that was just switched on.
TEST_P(ContactOf, NoMotionThatIsAllowedIsTakenForAContact) {
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  std::mt19937 random(8);
  RobotRig rig(as_delivered(GetParam()));
  for (int trial = 0; trial < 12; ++trial) {
    const Joints from = reported(rig.state().q_d);
    Joints to = joints(models::kHome);
    for (double& q : to) q += std::uniform_real_distribution(-0.5, 0.5)(random);
    ASSERT_EQ(rig.start(Mode::kJointPosition, ControllerMode::kJointImpedance), Status::kMotionStarted);
    const int n = static_cast<int>(std::ceil(1000 * shortest(limits, from, to)));
    fci::RobotCommand command;
    for (int i = 1; i <= n + 20; ++i) {
      command.q_c = array(from + ArmRig::minimum_jerk(std::min(1., double(i) / n)) * (to - from));
      rig.cycle(command);
      ASSERT_EQ(rig.state().robot_mode, RobotMode::kMove) << fci::names(rig.state().errors);
      ASSERT_EQ(rig.state().joint_contact, fci::Vector7{});
      ASSERT_EQ(rig.state().cartesian_contact, fci::Vector6{});
    }
    command.motion_generation_finished = true;
    rig.cycle(command);
    ASSERT_EQ(rig.robot.outcome(), Status::kSuccess);
  }
}

// The estimate alone, through the whole range and the singularities in it; the arm stands so high that it meets
// nothing.
TEST_P(ContactOf, MotionIsFeltAsNoForceInAnyPosture) {
  const SceneFile scene(R"(<mujoco><worldbody><site name="arm" pos="0 0 3"/></worldbody></mujoco>)");
  World::Options options = as_delivered(GetParam());
  options.scene = scene.path();
  const models::Limits& limits = models::limits(*options.arm, 10);
  ArmRig rig(options);
  Sensors sensors(*options.arm, false, 1);
  ExternalForce force;
  std::mt19937 random(3);
  for (int trial = 0; trial < 24; ++trial) {
    const Joints from = rig.generator.desired().q;
    Joints to;
    for (int i = 0; i < 7; ++i) {
      const double way = limits.q_max[i] - limits.q_min[i];
      to[i] = std::uniform_real_distribution(limits.q_min[i] + 0.03 * way, limits.q_max[i] - 0.03 * way)(random);
    }
    if (trial % 4 == 3) to << 0, 0, 0, -0.13, 0, 0.6, 0;  // stretched out
    rig.generator.start(Mode::kJointPosition, from, rig.F_T_EE);
    const int n = static_cast<int>(std::ceil(1000 * shortest(limits, from, to)));
    fci::RobotCommand command;
    for (int i = 1; i <= n; ++i) {
      command.q_c = array(from + ArmRig::minimum_jerk(double(i) / n) * (to - from));
      rig.generator.step(command);
      rig.cycle();
      sensors.read(rig.world.truth());
      rig.model.update(sensors.q, sensors.dq);
      force.update(rig.model, sensors, rig.F_T_EE);
      ASSERT_LT(force.tau.cwiseAbs().maxCoeff(), 0.5);  // N m
      ASSERT_LT(force.K_F_K.cwiseAbs().maxCoeff(), 3);  // N, N m
    }
  }
}

TEST_P(ContactOf, AboveTheLowerThresholdIsContactAndAboveTheUpperAReflex) {
  RobotRig rig(as_delivered(GetParam()));
  auto behavior = thresholds(50, 20);
  behavior.lower_force_thresholds_acceleration.fill(5);
  behavior.lower_force_thresholds_nominal.fill(5);
  ASSERT_EQ(rig.robot.set(behavior), Status::kSuccess);
  ASSERT_EQ(rig.start(Mode::kJointPosition, ControllerMode::kJointImpedance), Status::kMotionStarted);
  const auto hold = rig.hold();
  const auto drive = [&](int cycles) {
    for (int i = 0; i < cycles; ++i) rig.cycle(hold);
  };
  drive(10);
  rig.push((Wrench() << 0, 0, -10, 0, 0, 0).finished());
  drive(300);
  EXPECT_EQ(rig.state().cartesian_contact, (fci::Vector6{0, 0, 1, 0, 0, 0}));
  EXPECT_EQ(rig.state().cartesian_collision, fci::Vector6{});
  EXPECT_GT(rig.state().O_F_ext_hat_K[2], 8);  // the arm presses up
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kMove);

  rig.push((Wrench() << 0, 0, -30, 0, 0, 0).finished());
  drive(100);
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kReflex);
  EXPECT_EQ(rig.robot.outcome(), Status::kReflexAborted);
  EXPECT_TRUE(raised(rig.state(), Error::kCartesianReflex));
  EXPECT_FALSE(raised(rig.state(), Error::kJointReflex));
  EXPECT_EQ(rig.state().reflex_reason, rig.state().errors);
  rig.push(Wrench::Zero());
  rig.wait(0.5);
  EXPECT_EQ(rig.state().cartesian_contact, fci::Vector6{});
  EXPECT_EQ(rig.state().cartesian_collision, (fci::Vector6{0, 0, 1, 0, 0, 0}));
  EXPECT_LT(reported(rig.state().dq).norm(), 0.01);

  EXPECT_EQ(rig.robot.recover(), Status::kSuccess);
  rig.wait(0.1);
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kIdle);
  EXPECT_FALSE(fci::any(rig.state().errors));
  EXPECT_EQ(rig.state().cartesian_collision, fci::Vector6{});
}

TEST_P(ContactOf, AnArmThatHoldsStillIsGuardedAsWell) {
  RobotRig rig(as_delivered(GetParam()));
  ASSERT_EQ(rig.robot.set(thresholds(4, 100)), Status::kSuccess);
  rig.push((Wrench() << 0, 25, 0, 0, 0, 0).finished());
  rig.wait(0.3);
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kReflex);
  EXPECT_TRUE(raised(rig.state(), Error::kJointReflex));
  EXPECT_EQ(rig.state().joint_collision[0], 1);
  EXPECT_EQ(rig.robot.outcome(), std::nullopt);  // there was no motion that could have ended
  EXPECT_EQ(rig.start(Mode::kJointPosition, ControllerMode::kJointImpedance), Status::kNotPossible);
  // Who still pushes meets the reflex again.
  EXPECT_EQ(rig.robot.recover(), Status::kSuccess);
  rig.wait(0.3);
  EXPECT_EQ(rig.state().robot_mode, RobotMode::kReflex);
}

TEST_P(ContactOf, WhileTheReferenceAcceleratesTheOtherThresholdsApply) {
  RobotRig rig(as_delivered(GetParam()));
  auto behavior = thresholds(100, 100);
  behavior.lower_force_thresholds_nominal.fill(15);
  behavior.upper_force_thresholds_nominal.fill(15);
  ASSERT_EQ(rig.robot.set(behavior), Status::kSuccess);
  ASSERT_EQ(rig.start(Mode::kJointPosition, ControllerMode::kJointImpedance), Status::kMotionStarted);
  const Joints from = reported(rig.state().q_d);
  fci::RobotCommand command = rig.hold();
  const int n = 800;
  for (int i = 1; i < n; ++i) {
    command.q_c = array(from + 0.2 * ArmRig::minimum_jerk(double(i) / n) * Joints::Unit(0));
    if (i == 100) rig.push((Wrench() << 0, 0, 30, 0, 0, 0).finished());
    rig.cycle(command);
    if (i > 150 && reported(rig.state().ddq_d).norm() < 0.02) break;  // in the middle
    ASSERT_EQ(rig.state().robot_mode, RobotMode::kMove) << i;
  }
  const Joints way = 1e-3 * reported(rig.state().dq_d);  // of a cycle, from here on without acceleration
  for (int i = 0; i < 50; ++i) {
    command.q_c = array(joints(command.q_c) + way);
    rig.cycle(command);
  }
  EXPECT_TRUE(raised(rig.state(), Error::kCartesianReflex));
}

// In each of the nine ways to control it: at rest, while it accelerates, and while it moves evenly.
TEST_P(ContactOf, WhatPushesIsFeltInEveryControlMode) {
  struct Way {
    ControllerMode controller;
    Mode generator;
  };
  std::vector<Way> ways = {{ControllerMode::kExternal, Mode::kNone}};
  for (const auto controller :
       {ControllerMode::kJointImpedance, ControllerMode::kCartesianImpedance, ControllerMode::kExternal}) {
    for (const auto generator :
         {Mode::kJointPosition, Mode::kJointVelocity, Mode::kCartesianPosition, Mode::kCartesianVelocity}) {
      ways.push_back({controller, generator});
    }
  }
  constexpr double kAcceleration = 0.1;  // m/s² or rad/s²
  constexpr int kRising = 500;           // cycles
  struct When {
    int pushed;
    bool moves;
  };
  for (const Way& way : ways) {
    for (const auto& [pushed, moves] : {When{100, false}, {kRising / 2, true}, {kRising + 200, true}}) {
      RobotRig rig(as_delivered(GetParam()));
      ASSERT_EQ(rig.robot.set(thresholds(10, 10)), Status::kSuccess);
      ASSERT_EQ(rig.start(way.generator, way.controller), Status::kMotionStarted);
      const fci::RobotCommand hold = rig.hold();
      const Joints begin = reported(hold.q_c);
      double speed = 0, position = 0;
      const auto cycle = [&](int i) {
        speed += moves && i > 3 && i <= kRising ? kAcceleration * 1e-3 : 0;
        position += speed * 1e-3;
        fci::RobotCommand command = hold;
        command.q_c[0] += position;
        command.dq_c[0] = speed;
        command.O_T_EE_c[13] += position;
        command.O_dP_EE_c[1] = speed;
        const bool alone = way.generator == Mode::kNone;
        const Joints q_d = alone ? Joints(begin + position * Joints::Unit(0)) : reported(rig.state().q_d);
        const Joints dq_d = alone ? Joints(speed * Joints::Unit(0)) : reported(rig.state().dq_d);
        const Joints stiffness = (Joints() << 300, 300, 300, 300, 100, 60, 30).finished();
        command.tau_J_d = array(stiffness.cwiseProduct(q_d - reported(rig.state().q)) +
                                1.2 * stiffness.cwiseSqrt().cwiseProduct(dq_d - reported(rig.state().dq)));
        rig.cycle(command);
      };
      int i = 0;
      for (; i < pushed; ++i) {
        cycle(i);
        ASSERT_EQ(rig.state().robot_mode, RobotMode::kMove) << fci::names(rig.state().errors);
      }
      const std::string what = std::to_string(int(way.controller)) + " " + std::to_string(int(way.generator)) +
                               ", pushed in cycle " + std::to_string(pushed);
      rig.push((Wrench() << 0, 0, -40, 0, 0, 0).finished());
      for (; i < pushed + 60 && rig.state().robot_mode == RobotMode::kMove; ++i) cycle(i);
      EXPECT_EQ(rig.state().robot_mode, RobotMode::kReflex) << what;
      EXPECT_EQ(rig.robot.outcome(), Status::kReflexAborted) << what;
      EXPECT_TRUE(raised(rig.state(), Error::kCartesianReflex)) << what;
      EXPECT_EQ(rig.state().cartesian_collision[2], 1) << what;
      EXPECT_EQ(rig.state().cartesian_contact[2], 1) << what;
    }
  }
}

// --- sensors ---------------------------------------------------------------------------------------------------------

TEST_P(ContactOf, SensorsHaveTheirNoiseAndNoMore) {
  RobotRig rig(as_delivered(GetParam()));
  rig.wait(0.5);
  constexpr int kSamples = 4000;
  Joints q = Joints::Zero(), dq = Joints::Zero(), tau = Joints::Zero();
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  for (int i = 0; i < kSamples; ++i) {
    rig.cycle();
    const Truth& truth = rig.world.truth();
    q += (reported(rig.state().q) - joints(truth.q)).cwiseAbs2();
    dq += (reported(rig.state().dq) - joints(truth.dq)).cwiseAbs2();
    tau += (reported(rig.state().tau_J) - joints(truth.tau_J)).cwiseAbs2();
    force += reported(rig.state().O_F_ext_hat_K).head<3>().cwiseAbs2();
  }
  for (int i = 0; i < 7; ++i) {
    EXPECT_NEAR(std::sqrt(q[i] / kSamples), kPositionNoise, 0.1 * kPositionNoise);
    EXPECT_NEAR(std::sqrt(dq[i] / kSamples), kVelocityNoise, 0.1 * kVelocityNoise);
    EXPECT_NEAR(std::sqrt(tau[i] / kSamples), kTorqueNoise, 0.1 * kTorqueNoise);
  }
  // The data sheet's force noise is 0.035 N.
  for (int i = 0; i < 3; ++i) {
    EXPECT_GT(std::sqrt(force[i] / kSamples), 0.01);
    EXPECT_LT(std::sqrt(force[i] / kSamples), 0.07);
  }
}

TEST_P(ContactOf, TheSameSeedMakesTheSameNoise) {
  const World::Options options = as_delivered(GetParam());
  World world(options);
  Robot a(*options.arm), b(*options.arm), other(*options.arm, false, 2);
  for (int i = 0; i < 100; ++i) {
    for (Robot* robot : {&a, &b, &other}) robot->sense(world.truth());
    ASSERT_EQ(a.state().q, b.state().q);
    ASSERT_EQ(a.state().tau_ext_hat_filtered, b.state().tau_ext_hat_filtered);
    ASSERT_NE(a.state().dq, other.state().dq);
  }
}

TEST_P(ContactOf, IdealSensorsSayWhatIs) {
  World::Options options = as_delivered(GetParam());
  options.ideal = true;
  RobotRig rig(options);
  rig.push((Wrench() << 3, 2, -5, 0, 0, 0).finished());
  for (int i = 0; i < 200; ++i) {
    rig.cycle();
    EXPECT_EQ(rig.state().q, rig.world.truth().q);
    EXPECT_EQ(rig.state().dq, rig.world.truth().dq);
    EXPECT_EQ(rig.state().tau_J, rig.world.truth().tau_J);
    EXPECT_EQ(rig.state().theta, rig.state().q);
    EXPECT_EQ(rig.state().dtheta, rig.state().dq);
  }
}

TEST_P(ContactOf, MotorsAreBehindTheSpringsOfTheirJoints) {
  RobotRig rig(as_delivered(GetParam()));
  rig.push((Wrench() << 3, 2, -5, 0, 0, 0).finished());
  for (int i = 0; i < 200; ++i) {
    rig.cycle();
    for (int j = 0; j < 7; ++j) {
      EXPECT_NEAR(kJointStiffness * (rig.state().theta[j] - rig.state().q[j]), rig.state().tau_J[j], 1e-9);
      EXPECT_NEAR(kJointStiffness * (rig.state().dtheta[j] - rig.state().dq[j]), rig.state().dtau_J[j], 1e-9);
    }
  }
}

// Against the second differences of where the joints are.
TEST_P(ContactOf, AccelerometersFeelMotionAndWeight) {
  World::Options options = as_delivered(GetParam());
  const models::Arm& arm = *options.arm;
  const auto frames = [&](double t) {
    std::array<Eigen::Isometry3d, 7> all;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    for (int i = 0; i < 7; ++i) {
      const auto& [xyz, rpy] = arm.joints[i];
      T.translate(Eigen::Vector3d(xyz.data()));
      T.rotate(Eigen::AngleAxisd(rpy[2], Eigen::Vector3d::UnitZ()) *
               Eigen::AngleAxisd(rpy[1], Eigen::Vector3d::UnitY()) *
               Eigen::AngleAxisd(rpy[0], Eigen::Vector3d::UnitX()));
      T.rotate(Eigen::AngleAxisd(models::kHome[i] + 0.3 * std::sin(3 * t + i), Eigen::Vector3d::UnitZ()));
      all[i] = T;
    }
    return all;
  };
  Sensors sensors(arm, true, 1);
  for (int cycle = 0; cycle < 500; ++cycle) {
    const double t = 0.001 * cycle;
    Truth truth;
    for (int i = 0; i < 7; ++i) {
      truth.q[i] = models::kHome[i] + 0.3 * std::sin(3 * t + i);
      truth.dq[i] = 0.9 * std::cos(3 * t + i);
    }
    sensors.read(truth);
    if (cycle % 100 != 99) continue;
    constexpr double kStep = 1e-4;
    const auto before = frames(t - kStep), now = frames(t), after = frames(t + kStep);
    for (int i = 0; i < 6; ++i) {
      for (const auto& [sensor, at] :
           {std::pair{&sensors.accelerometer_bottom, i}, {&sensors.accelerometer_top, i + 1}}) {
        const Eigen::Vector3d acceleration =
            (after[at].translation() - 2 * now[at].translation() + before[at].translation()) / (kStep * kStep);
        const Eigen::Vector3d felt = now[i].linear().transpose() * (acceleration + Eigen::Vector3d(0, 0, 9.81));
        EXPECT_LT((Eigen::Vector3d(sensor->data() + 3 * i) - felt).norm(), 0.02) << "link " << i + 1;
      }
    }
  }
}

}  // namespace
}  // namespace sim
