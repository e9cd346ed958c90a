// What the simulated world owes to physics, whatever the arm does.

#include <gtest/gtest.h>

#include <cmath>

#include "tests/sim/arm_rig.hpp"
#include "tests/sim/scene_file.hpp"

namespace sim {
namespace {

// A ball of 1 kg on a rod without mass, let go at 1 rad, beside the arm and at the arm's own time step.
TEST(Physics, APendulumKeepsItsPeriodAndItsEnergy) {
  constexpr double kLength = 0.8, kStart = 1, kRadius = 0.03;
  const SceneFile scene(R"(<mujoco><worldbody>
    <site name="arm"/>
    <body name="pendulum" pos="0 2 2" euler="57.29577951308232 0 0"><joint type="hinge" axis="1 0 0"/>
      <geom type="sphere" pos="0 0 -0.8" size="0.03" mass="1"/></body></worldbody></mujoco>)");
  World::Options options = ideal(models::arm("fr3"));
  options.scene = scene.path();
  ArmRig rig(options);
  const auto angle = [&] { return kStart + rig.world.qpos().front(); };
  // Half a period is the time between two passages of the lowest point, where all energy is in the speed.
  std::vector<double> passages, speeds;
  double before = angle();
  for (int i = 1; i <= 10'000; ++i) {
    rig.cycle();
    const double now = angle();
    if (before * now <= 0) {
      passages.push_back(1e-3 * (i - now / (now - before)));
      speeds.push_back((now - before) / 1e-3);
    }
    before = now;
  }
  ASSERT_GT(passages.size(), 9u);
  // Inertia about the hinge, and the period of large swings by the complete elliptic integral of the first kind.
  const double inertia = kLength * kLength + 0.4 * kRadius * kRadius;
  const double period = 4 * std::sqrt(inertia / (9.81 * kLength)) * std::comp_ellint_1(std::sin(kStart / 2));
  const double measured = 2 * (passages.back() - passages.front()) / static_cast<double>(passages.size() - 1);
  EXPECT_NEAR(measured, period, 1e-3 * period);
  EXPECT_NEAR(std::pow(speeds.back() / speeds.front(), 2), 1, 1e-3);
}

TEST(Physics, APlateReadsTheForceThatIsCommanded) {
  for (const char* name : {"fer", "fr3"}) {
    World::Options options = ideal(models::arm(name));
    options.scene = REPOSITORY_DIR "/sim/scenes/plate.xml";
    ArmRig rig(options);
    rig.cartesian = true;
    rig.grip = -10;
    rig.move(pointing_down(0.5, 0, 0.204), 1.5);
    // Guided by springs in all but z, where the force alone acts.
    rig.controller.K_x << 1500, 1500, 0, 150, 150, 150;
    for (const double force : {-5., -15., -40.}) {
      for (int i = 0; i < 1500; ++i) {
        rig.model.update(rig.q(), rig.dq());
        const auto J = rig.model.jacobian(rig.F_T_EE.topRightCorner<3, 1>());
        const auto& desired = rig.generator.desired();
        Joints tau = rig.controller.cartesian_impedance(rig.model, rig.F_T_EE, rig.q(), rig.dq(), desired);
        tau += J.transpose() * (Wrench() << 0, 0, force - 20 * (J * rig.dq())[2], 0, 0, 0).finished();
        rig.world.step(array(tau + rig.model.gravity()), {rig.grip, rig.grip});
      }
      EXPECT_NEAR(rig.world.truth().contact_wrench[2], -force, 0.02 * -force) << name;
    }
  }
}

}  // namespace
}  // namespace sim
