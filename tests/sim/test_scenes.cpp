#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "sim/robot/external_force.hpp"
#include "sim/robot/sensors.hpp"
#include "tests/sim/arm_rig.hpp"

namespace sim {
namespace {

std::vector<std::string> scenes() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(REPOSITORY_DIR "/sim/scenes")) {
    if (entry.path().extension() == ".xml") names.push_back(entry.path().stem());
  }
  std::sort(names.begin(), names.end());
  return names;
}

class Scenes : public testing::TestWithParam<std::string> {};

// Arms that hold themselves, and things that lie where they were put.
TEST_P(Scenes, AreStill) {
  World::Options options;
  options.arm = &models::arm("fr3");
  options.scene = GetParam();
  const std::size_t arms = arms_in_scene(options.scene);
  options.more_arms.assign(arms - 1, &models::arm("fer"));
  World world(options);
  std::vector<ArmModel> models;
  for (std::size_t i = 0; i < arms; ++i) {
    models.emplace_back(i == 0 ? *options.arm : *options.more_arms[i - 1]);
    const RigidBody hand = franka_hand();
    models[i].set_tool(hand.mass, hand.com, hand.inertia);
  }
  std::vector<Drive> drives(arms);
  std::vector<std::array<double, 7>> before(world.objects().size());
  for (int cycle = 0; cycle < 2000; ++cycle) {
    if (cycle == 200) {  // things have settled
      for (std::size_t i = 0; i < before.size(); ++i) before[i] = world.object_pose(i);
    }
    for (std::size_t i = 0; i < arms; ++i) {
      models[i].update(joints(world.truth(i).q), joints(world.truth(i).dq));
      drives[i].tau_motor = array(models[i].gravity());
    }
    world.step(drives);
  }
  for (std::size_t i = 0; i < arms; ++i) {
    EXPECT_LT((joints(world.truth(i).q) - joints(models::kHome)).norm(), 1e-6);
    EXPECT_EQ(world.truth(i).contact_wrench, Vector6{});
  }
  for (std::size_t i = 0; i < before.size(); ++i) {
    const auto after = world.object_pose(i);
    for (int k = 0; k < 7; ++k) EXPECT_NEAR(after[k], before[i][k], 1e-4) << world.objects()[i];
  }
}

INSTANTIATE_TEST_SUITE_P(All, Scenes, testing::ValuesIn(scenes()), [](const auto& info) { return info.param; });

TEST(OurScenes, AreAllThatUsersAreToldOf) {
  const auto all = scenes();
  for (const char* name : {"empty", "table_with_blocks", "peg_in_hole", "door", "wiping", "soft_pad", "two_arms"}) {
    EXPECT_NE(std::find(all.begin(), all.end(), name), all.end()) << name;
  }
}

TEST(OurScenes, ThatAreAskedForByAWrongNameAreNamed) {
  try {
    arms_in_scene("peg_in_whole");
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("peg_in_hole"), std::string::npos) << error.what();
  }
}

// What the file says of the pad: 2000 N/m.
TEST(OurScenes, ASoftPadGivesWayAsItSays) {
  World::Options options = ideal(models::arm("fr3"));
  options.scene = "soft_pad";
  ArmRig rig(options);
  rig.cartesian = true;
  rig.grip = -10;
  rig.move(pointing_down(0.5, 0, 0.13), 1.5);
  const auto pad = [&] { return rig.world.object_pose(0)[2]; };
  ASSERT_EQ(rig.world.objects(), std::vector<std::string>{"pad"});
  const double free = pad();
  for (const double depth : {0.02, 0.04}) {
    rig.move(pointing_down(0.5, 0, 0.1 - depth), 1);
    rig.hold(1);
    const double force = rig.world.truth().contact_wrench[2];
    EXPECT_GT(force, 5);
    EXPECT_NEAR(force, 2000 * (free - pad()), 0.02 * force);
  }
}

TEST(OurScenes, APegOf20MillimetresFindsItsHole) {
  World::Options options = ideal(models::arm("fr3"));
  options.scene = "peg_in_hole";
  ArmRig rig(options);
  rig.cartesian = true;
  rig.move(pointing_down(0.5, -0.15, 0.06), 2);
  rig.grip = -40;
  rig.hold(0.5);
  rig.move(pointing_down(0.5, -0.15, 0.2), 1);
  rig.move(pointing_down(0.5, 0.15, 0.12), 1.5);
  EXPECT_NEAR(rig.world.object_pose(0)[2], 0.10, 0.003);  // in the hand, above the hole
  rig.move(pointing_down(0.5, 0.15, 0.055), 3);
  rig.hold(0.5);
  EXPECT_LT(rig.world.object_pose(0)[2], 0.042);  // the peg's middle: deep in a hole of 40 mm
}

TEST(OurScenes, ADoorOpensByItsHandle) {
  World::Options options = ideal(models::arm("fr3"));
  options.scene = "door";
  ArmRig rig(options);
  rig.cartesian = true;
  const auto angle_of_door = [&] { return -2 * std::asin(rig.world.object_pose(0)[6]); };
  const auto handle = [](double angle) {  // when the door stands open by this
    return Eigen::Vector3d(Eigen::Vector3d(0.68, 0.3, 0.3) +
                           Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitZ()) * Eigen::Vector3d(-0.065, -0.4, 0));
  };
  Eigen::Matrix4d forward = Eigen::Matrix4d::Identity();  // fingers ahead, to the left and right of the bar
  forward.topLeftCorner<3, 3>() << 0, 0, 1, 0, -1, 0, 1, 0, 0;
  const auto reach = [&](const Eigen::Vector3d& p, double seconds) {
    forward.topRightCorner<3, 1>() = p;
    rig.move(forward, seconds);
  };
  reach(handle(0) - Eigen::Vector3d(0.15, 0, 0), 3);
  reach(handle(0), 1);
  EXPECT_NEAR(angle_of_door(), 0, 1e-3);
  EXPECT_LT(distance(rig.O_T_TCP(), forward), 0.01);
  EXPECT_LT(angle(rig.O_T_TCP(), forward), 0.05);
  rig.grip = -40;
  rig.hold(0.3);
  for (int i = 1; i <= 10; ++i) reach(handle(0.05 * i), 0.4);
  rig.hold(0.5);
  EXPECT_NEAR(angle_of_door(), 0.5, 0.05);
}

// Across the tilted board and back, with a force along its normal that is commanded, by fingers on which its friction is 0.3.
TEST(OurScenes, ABoardIsWipedWithTheForceThatIsCommandedAndTheRobotFeelsIt) {
  constexpr double kForce = 12, kTilt = 20 * M_PI / 180;
  const Eigen::Vector3d normal(-std::sin(kTilt), 0, std::cos(kTilt));
  for (const char* name : {"fer", "fr3"}) {
    World::Options options = ideal(models::arm(name));
    options.scene = "wiping";
    ArmRig rig(options);
    Sensors sensors(*options.arm, false, 1);
    ExternalForce felt;
    rig.cartesian = true;
    rig.grip = -10;
    const auto over = [&](double y, double height) {
      Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
      pose.topLeftCorner<3, 3>() = Eigen::AngleAxisd(-kTilt, Eigen::Vector3d::UnitY()).toRotationMatrix() *
                                   Eigen::Vector3d(1, -1, -1).asDiagonal();
      pose.topRightCorner<3, 1>() = Eigen::Vector3d(0.55, y, 0.1) + height * normal;
      return pose;
    };
    rig.move(over(-0.12, 0.06), 2);
    rig.move(over(-0.12, 0.004), 1);
    rig.controller.K_x << 1500, 1500, 0, 150, 150, 150;  // along the hand's axes: none along the normal
    // Wrenches of the world on the hand, in truth and as felt: sums over the cycles.
    Wrench real = Wrench::Zero(), estimated = Wrench::Zero();
    const auto press = [&] {
      rig.model.update(rig.q(), rig.dq());
      const auto J = rig.model.jacobian(rig.F_T_EE.topRightCorner<3, 1>());
      const double along = normal.dot((J * rig.dq()).head<3>());
      Wrench push = Wrench::Zero();
      push.head<3>() = -(kForce + 20 * along) * normal;
      const Joints tau = rig.controller.cartesian_impedance(rig.model, rig.F_T_EE, rig.q(), rig.dq(), rig.generator.desired()) +
                         J.transpose() * push;
      rig.world.step(array(tau + rig.model.gravity()), {rig.grip, rig.grip});
      sensors.read(rig.world.truth());
      rig.model.update(sensors.q, sensors.dq);
      felt.update(rig.model, sensors, rig.F_T_EE);
      real += Wrench(rig.world.truth().contact_wrench.data());
      estimated -= felt.O_F_K;
    };
    for (int i = 0; i < 1000; ++i) press();
    for (const double way : {0.24, -0.24}) {
      const Eigen::Matrix4d from = rig.generator.desired().O_T_EE_d;
      Eigen::Matrix4d to = from;
      to(1, 3) += way;
      rig.generator.start(fci::MotionGeneratorMode::kCartesianPosition, rig.generator.desired().q, rig.F_T_EE);
      constexpr int kCycles = 3000, kWindow = 200;
      int windows = 0;
      for (int i = 1; i <= kCycles; ++i) {
        rig.generator.step(ArmRig::pose_command(ArmRig::between(from, to, ArmRig::minimum_jerk(double(i) / kCycles))));
        press();
        if (i % kWindow != 0) continue;
        const Eigen::Vector3d truth = real.head<3>() / kWindow, estimate = estimated.head<3>() / kWindow;
        real.setZero();
        estimated.setZero();
        if (i < 800 || i > kCycles - 600) continue;  // it comes to slide, and to rest
        ++windows;
        EXPECT_NEAR(truth.dot(normal), kForce, 0.05 * kForce) << name << " " << way << " cycle " << i;
        EXPECT_NEAR(truth[1], (way > 0 ? -0.3 : 0.3) * truth.dot(normal), 0.05 * kForce) << name << " " << way << " cycle " << i;
        EXPECT_LT((estimate - truth).norm(), 1 + 0.05 * truth.norm()) << name << " " << way << " cycle " << i;
      }
      EXPECT_GT(windows, 5);
    }
  }
}

// Arms in one world meet each other.
TEST(World, ArmsTouchEachOther) {
  World::Options options;
  options.arm = &models::arm("fr3");
  options.more_arms = {&models::arm("fr3")};
  options.scene = "two_arms";
  World world(options);
  std::array<Drive, 2> drives;
  ArmModel model(*options.arm);
  const RigidBody hand = franka_hand();
  model.set_tool(hand.mass, hand.com, hand.inertia);
  bool touched = false;
  // A hand pulls each towards the other, over the middle of the table.
  for (std::size_t i = 0; i < 2; ++i) {
    const auto& T = world.truth(i).O_T_TCP;
    const Vector3 here = {T[12], T[13], T[14]};
    world.pull({.path = {{2, {0.62, here[1], here[2]}}}, .stiffness = 400, .damping = 40, .max_force = 60}, 10, i);
  }
  for (int cycle = 0; cycle < 4000; ++cycle) {
    for (std::size_t i = 0; i < 2; ++i) {
      model.update(joints(world.truth(i).q), joints(world.truth(i).dq));
      drives[i].tau_motor = array(model.gravity() - 2 * joints(world.truth(i).dq));
    }
    world.step(drives);
    const auto& a = world.truth(0).contact_wrench;
    const auto& b = world.truth(1).contact_wrench;
    if (a[0] == 0) continue;
    touched = true;
    // What one does to the other it has from it; their bases face each other.
    EXPECT_NEAR(a[0], b[0], 1e-6 + 1e-6 * std::abs(a[0]));
    EXPECT_NEAR(a[2], -b[2], 1e-6 + 1e-6 * std::abs(a[2]));
  }
  EXPECT_TRUE(touched);
}

}  // namespace
}  // namespace sim
