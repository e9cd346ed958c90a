#include "sim/world/world.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "models/joint_figures.hpp"
#include "tests/sim/arm_rig.hpp"
#include "tests/sim/scene_file.hpp"

namespace sim {
namespace {

const std::string kScenes = REPOSITORY_DIR "/sim/scenes/";

std::string error_of(const World::Options& options) {
  try {
    World world(options);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

class WorldOf : public testing::TestWithParam<const char*> {
 protected:
  const models::Arm& arm = models::arm(GetParam());
};

TEST_P(WorldOf, StaysWhereGravityIsCompensated) {
  for (const bool is_ideal : {true, false}) {
    World::Options options = ideal(arm);
    options.ideal = is_ideal;
    options.q = {0.3, -0.6, 0.2, -2.0, 0.4, 1.7, -0.5};
    ArmRig rig(options);
    rig.model.update(rig.q(), Joints::Zero());
    const Vector7 tau = array(rig.model.gravity());
    for (int i = 0; i < 2000; ++i) rig.world.step(tau, {});
    EXPECT_LT((rig.q() - joints(options.q)).norm(), 1e-7);
  }
}

TEST_P(WorldOf, ReportsThePoseOfTheModel) {
  World::Options options = ideal(arm);
  options.q = {0.3, -0.6, 0.2, -2.0, 0.4, 1.7, -0.5};
  ArmRig rig(options);
  rig.model.update_kinematics(rig.q());
  EXPECT_LT((rig.O_T_TCP() - rig.model.O_T_F() * F_T_hand_TCP()).norm(), 1e-12);
}

// Kinetic and potential energy less the work of constant torques; until a joint meets its stop.
TEST_P(WorldOf, KeepsItsEnergy) {
  World::Options options = ideal(arm);
  options.hand = false;
  options.timestep = 1e-4;
  World world(options);
  ArmModel model(arm);
  const auto potential = [&](const Joints& q) {  // line integral of gravity from 0, by Simpson's rule
    constexpr int kPieces = 64;
    double sum = 0;
    for (int i = 0; i <= kPieces; ++i) {
      model.update(q * i / kPieces, Joints::Zero());
      sum += (i == 0 || i == kPieces ? 1 : i % 2 ? 4 : 2) * model.gravity().dot(q);
    }
    return sum / (3 * kPieces);
  };
  const auto kinetic = [&] {
    const Joints dq = joints(world.truth().dq);
    model.update(joints(world.truth().q), dq);
    return 0.5 * dq.dot(model.mass() * dq) + 0.5 * dq.cwiseAbs2().dot(joints(models::kMotorInertia));
  };
  model.update(joints(options.q), Joints::Zero());
  const Joints tau = model.gravity() + (Joints() << 3, -2, 2, 1.5, 0.5, 0.4, 0.3).finished();
  const auto energy = [&] {
    const Joints q = joints(world.truth().q);
    return kinetic() + potential(q) - tau.dot(q);
  };
  const double before = energy();
  const models::Limits& limits = models::limits(arm, 10);
  double swing = 0;
  int cycles = 0;
  for (bool inside = true; inside && cycles < 3000; ++cycles) {
    world.step(array(tau), {});
    for (int i = 0; i < 7; ++i) {
      inside &= world.truth().q[i] > limits.q_min[i] && world.truth().q[i] < limits.q_max[i];
    }
    inside &= world.truth().O_T_TCP[14] > 0.15;
    if (!inside) break;
    swing = std::max(swing, kinetic());
    if (cycles % 50 == 0) {
      ASSERT_NEAR(energy(), before, 1e-3 * (1 + swing)) << "after " << cycles << " ms";
    }
  }
  EXPECT_GT(cycles, 500);
  EXPECT_GT(swing, 3);  // J: it did move
}

TEST_P(WorldOf, TorqueAtTheLinksMovesTheLinks) {
  World::Options options;
  options.arm = &arm;
  options.hand = false;
  World world(options);
  ArmModel model(arm);
  std::mt19937 random(2);
  std::uniform_real_distribution<double> torque(-5, 5);
  for (int i = 0; i < 200; ++i) {
    model.update(joints(world.truth().q), joints(world.truth().dq));
    Joints tau = model.gravity();
    for (double& t : tau) t += torque(random);
    world.step(array(tau), {});
    const Joints at_links = model.mass() * joints(world.truth().ddq) + model.coriolis() + model.gravity();
    ASSERT_LT((joints(world.truth().tau_J) - at_links).norm(), 1e-6);
  }
}

INSTANTIATE_TEST_SUITE_P(Arms, WorldOf, testing::Values("fer", "fr3", "fr3v2"),
                         [](const auto& info) { return std::string(info.param); });

TEST(World, SameTorquesGiveTheSameBits) {
  World::Options options;
  options.arm = &models::arm("fr3");
  options.scene = kScenes + "table_with_block.xml";
  ArmRig a(options), b(options);
  for (ArmRig* rig : {&a, &b}) {
    rig->cartesian = true;
    rig->move(pointing_down(0.5, -0.15, 0.02), 1);
    rig->grip = -30;
    rig->hold(0.3);
    rig->move(pointing_down(0.45, 0.0, 0.1), 0.7);
  }
  EXPECT_TRUE(std::ranges::equal(a.world.qpos(), b.world.qpos()));
  EXPECT_EQ(a.world.truth().tau_J, b.world.truth().tau_J);
  EXPECT_EQ(a.world.truth().contact_wrench, b.world.truth().contact_wrench);
  EXPECT_EQ(a.world.truth().finger_force, b.world.truth().finger_force);
}

TEST(World, FrictionHoldsWhatIsLessThanIt) {
  World::Options options;
  options.arm = &models::arm("fr3");
  for (const bool is_ideal : {false, true}) {
    options.ideal = is_ideal;
    ArmRig rig(options);
    for (int i = 0; i < 1000; ++i) {
      rig.model.update(rig.q(), rig.dq());
      rig.world.step(array(rig.model.gravity() + 0.5 * models::kStickingShare * joints(models::kFrictionHeight)), {});
    }
    const double moved = (rig.q() - joints(options.q)).cwiseAbs().maxCoeff();
    if (is_ideal) {
      EXPECT_GT(moved, 0.05);
    } else {
      EXPECT_LT(moved, 1e-4);
    }
  }
}

TEST(World, FrictionTakesEnergyUntilTheArmRests) {
  World::Options options;
  options.arm = &models::arm("fr3");
  ArmRig rig(options);
  rig.world.push({0, 20, 0, 0, 0, 0});
  for (int i = 0; i < 6000; ++i) {
    if (i == 100) rig.world.push({});
    rig.model.update(rig.q(), rig.dq());
    rig.world.step(array(rig.model.gravity()), {});
  }
  EXPECT_GT((rig.q() - joints(options.q)).norm(), 0.01);
  EXPECT_LT(rig.dq().norm(), 1e-5);
}

TEST(World, PushingOnAPlateIsAnsweredByItsForce) {
  World::Options options = ideal(models::arm("fr3"));
  options.scene = kScenes + "plate.xml";
  ArmRig rig(options);
  rig.cartesian = true;
  rig.grip = -10;
  rig.move(pointing_down(0.5, 0, 0.22), 1.5);
  EXPECT_EQ(rig.world.truth().contact_wrench, Vector6{});
  rig.move(pointing_down(0.5, 0, 0.205), 1);
  rig.hold(1);
  const Wrench wrench(rig.world.truth().contact_wrench.data());
  EXPECT_GT(wrench[2], 5);
  // At rest the motors carry the arm's weight and what the plate presses.
  rig.model.update(rig.q(), Joints::Zero());
  const ArmModel::Matrix67 J = rig.model.jacobian(rig.F_T_EE.topRightCorner<3, 1>());
  const Joints carried = joints(rig.world.truth().tau_motor) - rig.model.gravity();
  EXPECT_LT((carried + J.transpose() * wrench).norm(), 1e-3 * carried.norm());
  EXPECT_LT(rig.dq().norm(), 1e-4);
}

class Grasp : public testing::TestWithParam<int> {};

TEST_P(Grasp, KeepsTheBlock) {
  World::Options options;
  options.arm = &models::arm("fr3");
  options.scene = kScenes + "table_with_block.xml";
  ArmRig rig(options);
  ASSERT_EQ(rig.world.objects(), std::vector<std::string>{"block"});
  rig.move(pointing_down(0.5, -0.15, 0.02), 1.5);
  rig.grip = -GetParam();
  rig.hold(0.4);
  const Truth& truth = rig.world.truth();
  for (int i = 0; i < 2; ++i) {
    EXPECT_NEAR(truth.finger[i], 0.02, 2e-4);
    EXPECT_NEAR(truth.finger_force[i], GetParam(), 0.05 * GetParam());
  }
  const auto in_hand = [&] {
    const auto block = rig.world.object_pose(0);
    const Eigen::Matrix4d T = rig.O_T_TCP();
    return Eigen::Vector3d(T.topLeftCorner<3, 3>().transpose() *
                           (Eigen::Vector3d(block.data()) - T.topRightCorner<3, 1>()));
  };
  const Eigen::Vector3d grasped = in_hand();
  rig.move(pointing_down(0.5, -0.15, 0.25), 0.8);
  rig.move(pointing_down(0.45, 0.2, 0.25), 0.8);
  Eigen::Matrix4d tilted = pointing_down(0.45, 0.2, 0.35);
  tilted.topLeftCorner<3, 3>() *= Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitX()).toRotationMatrix();
  rig.move(tilted, 1);
  rig.hold(0.5);
  EXPECT_LT((in_hand() - grasped).norm(), 1e-3);
  EXPECT_NEAR(Eigen::Vector3d(truth.contact_wrench.data()).norm(), 0.1 * 9.81, 0.02);
  EXPECT_NEAR(truth.finger[0], truth.finger[1], 2e-4);
}

INSTANTIATE_TEST_SUITE_P(Forces, Grasp, testing::Values(20, 60));

TEST(World, TellsPosesInTheBaseOfTheArm) {
  const SceneFile scene(R"(<mujoco><worldbody>
    <site name="arm" pos="1 2 0.5" euler="0 0 90"/>
    <body name="thing" pos="1 2.5 0.6"><freejoint/><geom size="0.02"/></body></worldbody></mujoco>)");
  World::Options options = ideal(models::arm("fr3"));
  const World at_origin(options);
  options.scene = scene.path();
  const World elsewhere(options);
  for (int i = 0; i < 16; ++i) EXPECT_NEAR(elsewhere.truth().O_T_TCP[i], at_origin.truth().O_T_TCP[i], 1e-12);
  const auto thing = elsewhere.object_pose(0);
  EXPECT_NEAR(thing[0], 0.5, 1e-12);
  EXPECT_NEAR(thing[1], 0, 1e-12);
  EXPECT_NEAR(thing[2], 0.1, 1e-12);
}

TEST(World, SaysWhatIsWrongWithAScene) {
  World::Options options = ideal(models::arm("fr3"));
  options.scene = "/nowhere/scene.xml";
  EXPECT_NE(error_of(options).find("/nowhere/scene.xml: no such file"), std::string::npos) << error_of(options);

  const auto expect = [&](const std::string& text, const std::string& part) {
    const SceneFile scene(text);
    options.scene = scene.path();
    const std::string error = error_of(options);
    EXPECT_NE(error.find(scene.path()), std::string::npos) << text << ": " << error;
    EXPECT_NE(error.find(part), std::string::npos) << text << ": " << error;
  };
  expect("<mujoco><worldbody>", "not MJCF");
  expect("<mujoco><worldbody><geom type='spere'/></worldbody></mujoco>", "spere");
  expect("<mujoco><worldbody/></mujoco>", "<site name=\"arm\"");
  expect("<mujoco><worldbody><body><site name='arm'/></body></worldbody></mujoco>", "<site name=\"arm\"");
  expect("<mujoco><worldbody><site name='arm' euler='10 0 0'/></worldbody></mujoco>", "tilted");
  expect("<mujoco><worldbody><site name='arm'/><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>",
         "has no name");
  const auto body = [](const std::string& is, const std::string& geom = "size='0.1'") {
    return "<mujoco><worldbody><site name='arm'/><body name='thing' " + is + "><freejoint/><geom " + geom +
           "/></body></worldbody></mujoco>";
  };
  expect(body("pos='nan 0 0'"), "pos of body \"thing\" is nan");
  expect(body("pos='0 0 inf'"), "pos of body \"thing\" is inf");
  expect(body("quat='1 nan 0 0'"), "orientation of body \"thing\"");
  expect(body("", "size='nan'"), "nan");
  expect(body("", "size='0.1' friction='nan 0 0'"), "friction of geom");
  expect("<mujoco><worldbody><site name='arm' pos='0 nan 0'/></worldbody></mujoco>", "nan");
  expect("<mujoco><worldbody><site name='arm'/><geom type='mesh' mesh='m'/></worldbody></mujoco>", "m");
}

}  // namespace
}  // namespace sim
