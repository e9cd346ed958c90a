#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "realtime/cholesky.hpp"
#include "realtime/controllers/admittance.hpp"
#include "realtime/controllers/felt_wrench.hpp"
#include "realtime/controllers/force_axis_impedance.hpp"
#include "realtime/controllers/force_position.hpp"
#include "realtime/controllers/hybrid_force_position.hpp"
#include "realtime/controllers/joint_impedance.hpp"
#include "realtime/controllers/lqr.hpp"
#include "realtime/controllers/pass_through.hpp"
#include "realtime/controllers/pass_through_joint_torque.hpp"
#include "realtime/controllers/require_holdable.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/symmetric_eigen.hpp"
#include "tests/parts/joints.hpp"
#include "tests/parts/refusal.hpp"
#include "tests/realtime/allocation_counter.hpp"
#include "tests/realtime/simulated_arm.hpp"

namespace {

using namespace realtime;
using testing_tools::SimulatedArm;


Vector6 along(int axis, double size) { return size * Vector6::Unit(axis); }

HybridForcePosition::Parameters pressing(double force) {
  return {Vector6::Unit(2), along(2, force), HybridForcePosition::Frame::kBase, Vector3::Constant(1500),
          Vector3::Constant(100), 1, 10, 0.5, 5, 0.01, 0.1};
}
ForcePosition::Parameters mixed(const Vector6& selection, bool cartesian) {
  Vector6 K;
  K << 1500, 1500, 1500, 100, 100, 100;
  return {selection, cartesian, K, Vector6::Constant(0.1), kStiffness, Vector7::Constant(0.1), 0.02};
}
Lqr::Parameters weights() {
  return {(Vector7() << 360000, 360000, 360000, 360000, 62500, 22500, 2500).finished(),
          (Vector7() << 400, 400, 400, 400, 100, 50, 10).finished(), Vector7::Ones()};
}
Admittance::Parameters floating(double stiffness) {
  Vector6 mass, damping, K;
  mass << 10, 10, 10, 0.5, 0.5, 0.5;
  damping << 100, 100, 100, 5, 5, 5;
  K << Vector3::Constant(stiffness), Vector3::Constant(stiffness / 10);
  return {mass, damping, K, 2000, 200};
}
PassThroughJointTorque::Parameters torques() {
  const Vector7 half = (Vector7() << 1, 0, 0, 1, 0, 0, 1).finished();
  return {half * 0.5, half, Vector7::Zero(), kStiffness, kDamping};
}
ForceAxisImpedance::Parameters along_axis(const Vector3& axis, double max_translation = 0) {
  return {axis, 600, 20, max_translation};
}

class ForceControllers : public testing::TestWithParam<const char*> {
 protected:
  SimulatedArm arm{GetParam(), kMotors};
  std::mt19937 random{7};
  Vector7 vector(double size) {
    Vector7 out;
    for (int i = 0; i < 7; ++i) out[i] = std::uniform_real_distribution<>(-size, size)(random);
    return out;
  }
};

INSTANTIATE_TEST_SUITE_P(Arms, ForceControllers, testing::Values("fer", "fr3"),
                         [](const auto& info) { return std::string(info.param); });

// Every law with its parameters, for what is the same of all.
struct Law {
  std::string name;
  std::unique_ptr<Controller> controller;
};
std::vector<Law> all_laws(const SimulatedArm& arm) {
  const auto law = [](std::string name, Controller* made) { return Law{name, std::unique_ptr<Controller>(made)}; };
  JointImpedance::Parameters modal{kStiffness, kDamping, 1.0};
  modal.inertia_scale = 0.8;
  modal.integral_rate = 1;
  modal.integral_limit = 5;
  const Vector6 no_z = Vector6::Ones() - Vector6::Unit(2);
  std::vector<Law> laws;
  laws.push_back(law("PassThrough", new PassThrough({0.1, 0.2})));
  laws.push_back(law("ForceAxisImpedance", new ForceAxisImpedance(along_axis({1, 2, 3}, 0.1))));
  laws.push_back(law("PassThroughJointTorque", new PassThroughJointTorque(torques(), arm.model.mass())));
  laws.push_back(law("ForcePosition", new ForcePosition(mixed(no_z, true))));
  laws.push_back(law("ForcePosition of joints", new ForcePosition(mixed(no_z, false))));
  laws.push_back(law("HybridForcePosition", new HybridForcePosition(pressing(-10))));
  laws.push_back(law("Lqr", new Lqr(weights(), arm.model.mass())));
  laws.push_back(law("Admittance", new Admittance(floating(0))));
  laws.push_back(law("JointImpedance", new JointImpedance(modal, arm.model.mass())));
  return laws;
}

TEST_P(ForceControllers, an_admittance_that_stays_forgets_how_far_it_was_led) {
  Admittance law(floating(200));
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  arm.state.O_F_ext_hat_K = {0, -10, 0, 0, 0, 0};
  Vector7 tau;
  for (int n = 0; n < 2000; ++n) {
    law.step(arm.cycle, reference, tau);
    arm.step(tau);
  }
  arm.state.O_F_ext_hat_K = {};
  reference = pose_reference(arm);  // it has touched something, and rests
  law.stay();
  law.step(arm.cycle, reference, tau);
  const Vector7 held = tau - arm.model.coriolis();
  EXPECT_LT(held.cwiseAbs().maxCoeff(), 2) << "which a spring of 50 mm would not be";
}

TEST_P(ForceControllers, an_admittance_does_not_go_where_its_arm_cannot) {
  Admittance law(floating(0));
  const Reference reference = pose_reference(arm);
  Reference moved = reference;
  law.start(arm.cycle, moved);
  Vector7 tau;
  const auto force = [&](double felt, int ms) {  // of an arm that something holds, along y; N
    arm.state.O_F_ext_hat_K = {0, -felt, 0, 0, 0, 0};
    for (int n = 0; n < ms; ++n) law.step(arm.cycle, reference, tau);
    const realtime::Matrix67& J = arm.model.jacobian();
    return (J * J.transpose()).ldlt().solve(J * (tau - arm.model.coriolis())).eval()[1];
  };
  const double pulled = force(20, 3000);
  EXPECT_GT(pulled, 50);
  EXPECT_LT(pulled, 150) << "of 2000 N/m, 5 cm away";
  EXPECT_LT(force(-20, 600), 0) << "and comes back as soon as it is pulled back";
}

TEST_P(ForceControllers, an_integral_of_the_joints_is_stable_at_its_fastest_on_any_spring) {
  for (const double K : {20., 100., 600.}) {
    for (const bool ratio : {true, false}) {
      SimulatedArm fresh(GetParam(), kMotors);
      JointImpedance::Parameters parameters{Vector7::Constant(K), Vector7::Constant(std::sqrt(K))};
      if (ratio) parameters.damping_ratio = 0.7;
      parameters.integral_rate = 10;
      parameters.integral_limit = 20;
      JointImpedance law(parameters, fresh.model.mass());
      Reference reference;
      reference.motion = Channels::kJoint;
      reference.joint.q = fresh.q;
      law.start(fresh.cycle, reference);
      reference.joint.q += Vector7::Constant(0.05);
      Vector7 tau;
      for (int n = 0; n < 40'000; ++n) {
        law.step(fresh.cycle, reference, tau);
        fresh.step(tau);
      }
      EXPECT_LT(fresh.dq.norm(), 5e-3) << K << (ratio ? ", of a ratio" : "");
      EXPECT_LT((fresh.q - reference.joint.q).norm(), 5e-3) << K << (ratio ? ", of a ratio" : "");
    }
  }
}

TEST_P(ForceControllers, an_lqr_is_stable_where_the_arm_is_lighter_than_it_was) {
  const models::Limits limits = models::limits(models::arm(GetParam()), 5);
  for (const double weight : {0.05, 0.02, 0.007}) {
    Lqr::Parameters hard = weights();
    hard.torque_weight.setConstant(weight);
    for (int k = 0; k < 30; ++k) {
      SimulatedArm fresh(GetParam(), kMotors);
      Lqr law(hard, fresh.model.mass());
      for (int i = 0; i < 7; ++i) {
        const double share = std::uniform_real_distribution<>(0.1, 0.9)(random);
        fresh.q[i] = limits.q_min[i] + share * (limits.q_max[i] - limits.q_min[i]);
      }
      fresh.dq.setConstant(0.02);
      fresh.observe();
      Reference reference;
      reference.motion = Channels::kJoint;
      reference.joint.q = fresh.q;
      Vector7 tau;
      double fastest = 0;
      for (int n = 0; n < 600 && fastest < 1; ++n) {
        law.step(fresh.cycle, reference, tau);
        fresh.step(tau);
        if (n > 400) fastest = std::max(fastest, fresh.dq.cwiseAbs().maxCoeff());
      }
      EXPECT_LT(fastest, 5e-3) << weight << " at " << reference.joint.q.transpose();
    }
  }
}

TEST_P(ForceControllers, the_stiffest_gains_of_EE_are_held_anywhere) {
  ForcePosition::Parameters parameters = mixed(Vector6::Ones(), true);
  parameters.position_kps_cart << Vector3::Constant(3000), Vector3::Constant(300);
  for (const auto& q : {Vector7(Vector7::Map(models::kHome.data())), (Vector7() << 0, 0.5, 0, -1.5, 0, 2.0, 0.8).finished(),
                        (Vector7() << 0, 0.3, 0, -1.9, 0, 2.5, 0.8).finished()}) {
    SimulatedArm fresh(GetParam(), kMotors);
    fresh.q = q;
    fresh.observe();
    ForcePosition law(parameters, fresh.model.mass());
    Reference reference = pose_reference(fresh);
    law.start(fresh.cycle, reference);
    fresh.dq[6] = 0.1;
    fresh.observe();
    Vector7 tau;
    for (int n = 0; n < 3000; ++n) {
      law.step(fresh.cycle, reference, tau);
      fresh.step(tau);
    }
    EXPECT_LT(fresh.dq.norm(), 5e-3) << q.transpose();
  }
}

TEST_P(ForceControllers, where_there_is_no_spring_no_arm_is_led) {
  auto parameters = mixed(Vector6::Ones(), true);
  parameters.position_kps_cart[2] = 0;
  parameters.selection[4] = 0.5;
  const ForcePosition law(parameters);
  const Vector6 way = Vector6::Ones();
  EXPECT_EQ(law.led_pose(arm.cycle, way), (Vector6() << 1, 1, 0, 1, 1, 1).finished());
}

// --- a wrench ------------------------------------------------------------------------------------------------------------

TEST_P(ForceControllers, the_torque_of_a_wrench_does_its_work) {
  PassThrough law({0, 0});
  for (int n = 0; n < 20; ++n) {
    arm.q += vector(0.1);
    arm.observe();
    Reference reference = pose_reference(arm);
    reference.wrench = 10 * vector(1).head<6>();
    Vector7 tau;
    law.start(arm.cycle, reference);
    law.step(arm.cycle, reference, tau);
    // By forward kinematics alone.
    const Vector7 way = vector(1);
    constexpr double h = 1e-5;
    const Eigen::Isometry3d before = arm.model.O_T_EE(Vector7(arm.q - h * way));
    const Eigen::Isometry3d after = arm.model.O_T_EE(Vector7(arm.q + h * way));
    const Vector3 moved = (after.translation() - before.translation()) / (2 * h);
    const Eigen::Matrix3d turn = after.linear() * before.linear().transpose();
    const Vector3 turned = log(Eigen::Quaterniond(turn)) / (2 * h);
    EXPECT_NEAR(tau.dot(way), reference.wrench.head<3>().dot(moved) + reference.wrench.tail<3>().dot(turned), 1e-5);
  }
}

TEST_P(ForceControllers, a_wrench_ends_where_its_cap_is_and_the_arm_comes_to_rest) {
  for (const bool axis : {false, true}) {
    SimulatedArm fresh(GetParam(), kMotors);
    std::unique_ptr<Controller> law(axis ? static_cast<Controller*>(new ForceAxisImpedance(along_axis({0, 1, 0}, 0.05)))
                                         : new PassThrough({0.05, 0}));
    Reference reference = pose_reference(fresh);
    const Vector3 began = reference.cartesian.position;
    reference.wrench[1] = 20;
    law->start(fresh.cycle, reference);
    Vector7 tau;
    double fastest = 0;
    for (int k = 0; k < 3000; ++k) {
      law->step(fresh.cycle, reference, tau);
      fresh.step(tau);
      fastest = std::max(fastest, fresh.dq.cwiseAbs().maxCoeff());
    }
    const double moved = (fresh.cycle.O_T_EE.translation() - began).norm();
    EXPECT_GT(moved, 0.045);
    EXPECT_LT(moved, 0.12);
    EXPECT_GT(fastest, 0.3);
    EXPECT_LT(fresh.dq.norm(), 0.01);
  }
}

TEST_P(ForceControllers, across_its_axis_a_force_is_held_by_springs) {
  const Vector3 axis = Vector3(1, 0, -2).normalized(), across = Vector3::UnitY();
  ForceAxisImpedance law(along_axis(3 * axis));
  Reference reference = pose_reference(arm);
  const Reference began = reference;
  reference.wrench << 15 * axis + 30 * across, 2, 2, 2;  // of which only what lies along the axis counts
  law.start(arm.cycle, reference);
  Vector7 tau;
  for (int k = 0; k < 4000; ++k) {  // something pushes back along the axis, and aside
    law.step(arm.cycle, reference, tau);
    arm.step(tau, arm.model.jacobian().topRows<3>().transpose() * (6 * across - 15 * axis));
  }
  const Vector3 moved = arm.cycle.O_T_EE.translation() - began.cartesian.position;
  EXPECT_NEAR(moved.dot(across), 6 / 600.0, 2e-5);
  EXPECT_NEAR(moved.dot(axis.cross(across)), 0, 2e-4);
  EXPECT_LT(log(Eigen::Quaterniond(arm.cycle.O_T_EE.linear()) * began.cartesian.orientation.conjugate()).norm(), 0.01);
}

// --- joint torques -------------------------------------------------------------------------------------------------------

TEST_P(ForceControllers, gravity_of_the_tool_is_the_slope_of_its_height) {
  const Vector3 com(0.02, -0.03, 0.08);
  for (int n = 0; n < 10; ++n) {
    arm.q += vector(0.2);
    arm.set_tool(2, com);
    const Vector7 with = arm.model.gravity({0, 0, -9.81});
    arm.set_tool(0, com);
    const Vector7 without = arm.model.gravity({0, 0, -9.81});
    EXPECT_NEAR(with[0], 0, 1e-9);  // about the vertical
    Eigen::Isometry3d F_T_C = Eigen::Isometry3d::Identity();
    F_T_C.translation() = com;
    arm.model.set_tool(0, com, Eigen::Matrix3d::Identity(), F_T_C);
    for (int i = 0; i < 7; ++i) {
      constexpr double h = 1e-5;
      const auto height = [&](double by) {
        return arm.model.O_T_EE(Vector7(arm.q + by * Vector7::Unit(i))).translation().z();
      };
      EXPECT_NEAR(with[i] - without[i], 2 * 9.81 * (height(h) - height(-h)) / (2 * h), 1e-6);
    }
  }
}

TEST_P(ForceControllers, joints_get_their_torque_or_are_held) {
  PassThroughJointTorque::Parameters parameters = torques();
  PassThroughJointTorque law(parameters, arm.model.mass());
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  const Vector7 began = arm.q;
  arm.q += vector(0.05);
  arm.dq = vector(0.3);
  arm.observe();
  reference.torque = vector(2);
  Vector7 tau;
  law.step(arm.cycle, reference, tau);
  for (int i = 0; i < 7; ++i) {
    const double held = kStiffness[i] * (began[i] - arm.q[i]) - kDamping[i] * arm.dq[i];
    const double given = parameters.torque[i] + reference.torque[i];
    EXPECT_NEAR(tau[i] - arm.model.coriolis()[i], parameters.selection[i] == 1 ? given : held, 1e-9);
  }
  parameters.remove_gravity[3] = 1;
  Vector7 falling;
  PassThroughJointTorque heavy(parameters, arm.model.mass());
  heavy.start(arm.cycle, reference);
  heavy.step(arm.cycle, reference, falling);
  EXPECT_GT(std::abs(arm.model.gravity({0, 0, -9.81})[3]), 1);
  law.start(arm.cycle, reference);
  law.step(arm.cycle, reference, tau);
  EXPECT_NEAR((tau - falling)[3], arm.model.gravity({0, 0, -9.81})[3], 1e-9);
  EXPECT_NEAR((tau - falling)[1], 0, 1e-9);
  arm.state.O_ddP_O = {0, -9.81, 0};  // on a wall
  heavy.step(arm.cycle, reference, falling);
  EXPECT_NEAR((tau - falling)[3], arm.model.gravity({0, -9.81, 0})[3], 1e-9);
}

// --- force ---------------------------------------------------------------------------------------------------------------

// A level surface, and what a robot says of the force on it: with a low-pass of 15 Hz, some of it late.
struct Surface {
  double height, stiffness = 3e4, damping = 100;
  double truth = 0;
  Vector3 felt = Vector3::Zero();

  Vector7 push(SimulatedArm& arm, double friction) {
    const Vector3 p = arm.cycle.O_T_EE.translation();
    const Vector3 v = arm.model.jacobian().topRows<3>() * arm.dq;
    truth = p.z() < height ? std::max(stiffness * (height - p.z()) - damping * v.z(), 0.0) : 0;
    const double speed = v.head<2>().norm();
    Vector3 force(0, 0, truth);
    if (speed > 1e-3) force.head<2>() = -friction * truth * v.head<2>() / speed;
    felt += (1 - std::exp(-2 * M_PI * 15 * SimulatedArm::kDt)) * (-force - felt);
    Vector3::Map(arm.state.O_F_ext_hat_K.data()) = felt;
    return arm.model.jacobian().topRows<3>().transpose() * force;
  }
};

struct Pressed {
  double most = 0, fastest = 0, rms = 0, end = 0, aside = 0;  // N estimated, m/s in free space, N, N, m
};

// Down from 2 cm above a surface, and then to and fro along y.
Pressed press(SimulatedArm& arm, Controller& law, double wanted, bool by_wrench, double friction = 0.2) {
  Reference reference = pose_reference(arm);
  if (by_wrench) reference.wrench[2] = wanted;
  law.start(arm.cycle, reference);
  const Reference began = reference;
  Surface surface{began.cartesian.position.z() - 0.02};
  Pressed out;
  Vector7 tau;
  int samples = 0;
  for (int k = 0; k < 8000; ++k) {
    const double t = std::max(0.0, k * SimulatedArm::kDt - 4), w = 3;
    reference.cartesian.position.y() = began.cartesian.position.y() + 0.04 * (1 - std::cos(w * t));
    reference.cartesian.velocity[1] = 0.04 * w * std::sin(w * t);
    reference.cartesian.acceleration[1] = t > 0 ? 0.04 * w * w * std::cos(w * t) : 0;
    law.step(arm.cycle, reference, tau);
    const double v = (arm.model.jacobian() * arm.dq)[2];
    arm.step(tau, surface.push(arm, friction));
    if (surface.felt.norm() == 0) out.fastest = std::max(out.fastest, std::abs(v));
    out.most = std::max(out.most, -surface.felt.z());
    if (k < 4000) out.end = -surface.felt.z() + wanted;
    if (k > 4500) {
      out.rms += std::pow(-surface.truth - wanted, 2);
      out.aside = std::max(out.aside, std::abs(arm.cycle.O_T_EE.translation().y() - reference.cartesian.position.y()));
      ++samples;
    }
  }
  out.rms = std::sqrt(out.rms / samples);
  return out;
}

TEST_P(ForceControllers, hybrid_control_presses_on_a_surface_and_wipes_it) {
  for (const bool by_wrench : {false, true}) {
    for (const double force : {-5.0, -10.0, -30.0}) {
      SimulatedArm fresh(GetParam(), kMotors);
      HybridForcePosition law(pressing(by_wrench ? 0 : force));
      const Pressed done = press(fresh, law, force, by_wrench);
      EXPECT_LT(done.most, -1.2 * force) << force;  // overshoot
      EXPECT_LT(done.fastest, 0.011) << force;
      EXPECT_LT(std::abs(done.end), 0.01 * -force) << force;
      EXPECT_LT(done.rms, 0.05 * -force) << force;
      EXPECT_LT(done.aside, 0.01);
    }
  }
}

TEST_P(ForceControllers, hybrid_control_along_the_axes_of_EE_is_the_same_where_they_are_those_of_the_base) {
  SimulatedArm fresh(GetParam(), kMotors);
  HybridForcePosition::Parameters parameters = pressing(10);  // the hand points down
  parameters.frame = HybridForcePosition::Frame::kEndEffector;
  HybridForcePosition law(parameters);
  const Pressed done = press(fresh, law, -10, false);
  EXPECT_LT(done.most, 12);
  EXPECT_LT(std::abs(done.end), 0.1);
  EXPECT_LT(done.rms, 0.5);
}

TEST_P(ForceControllers, hybrid_control_without_force_axes_is_cartesian_impedance) {
  HybridForcePosition::Parameters parameters = pressing(0);
  parameters.force_axes.setZero();
  HybridForcePosition hybrid(parameters);
  CartesianImpedance impedance({parameters.translational_stiffness, parameters.rotational_stiffness, 1, 10});
  EXPECT_TRUE(hybrid.tracks());
  EXPECT_FALSE(HybridForcePosition(pressing(-1)).tracks());
  Reference a = pose_reference(arm), b = a;
  arm.dq = vector(0.2);
  arm.tau = vector(1);
  arm.observe();
  Vector7 tau, expected;
  hybrid.start(arm.cycle, a);
  impedance.start(arm.cycle, b);
  hybrid.step(arm.cycle, a, tau);
  impedance.step(arm.cycle, b, expected);
  EXPECT_LT((tau - expected).norm(), 1e-9);
}

// Lambda decouples: a motion of the reference asks for no acceleration along the force axis.
TEST_P(ForceControllers, motion_across_does_not_accelerate_the_force_axis) {
  SimulatedArm ideal(GetParam());
  HybridForcePosition law(pressing(0));
  Reference reference = pose_reference(ideal);
  law.start(ideal.cycle, reference);
  reference.cartesian.acceleration << 1, -2, 3, 1, 1, 1;
  Vector7 tau;
  law.step(ideal.cycle, reference, tau);
  const Vector6 a = ideal.model.jacobian() * joint_mobility(ideal.model.mass()) * tau;
  EXPECT_NEAR(a[0], 1, 0.02);
  EXPECT_NEAR(a[1], -2, 0.02);
  EXPECT_NEAR(a[2], 0, 0.02);
}

TEST_P(ForceControllers, force_position_presses_with_gains_of_EE_and_of_joints) {
  for (const bool cartesian : {true, false}) {
    SimulatedArm fresh(GetParam(), kMotors);
    ForcePosition law(mixed(Vector6::Ones() - Vector6::Unit(2), cartesian));
    EXPECT_FALSE(law.tracks());
    const Pressed done = press(fresh, law, -10, true, 0);
    EXPECT_LT(done.most, 12) << cartesian;
    EXPECT_LT(done.fastest, 0.022);
    EXPECT_LT(std::abs(done.end), 0.3) << cartesian;
    EXPECT_LT(done.rms, 1) << cartesian;
  }
}

TEST_P(ForceControllers, force_position_of_position_alone_comes_to_its_reference) {
  for (const bool cartesian : {true, false}) {
    SimulatedArm fresh(GetParam(), kMotors);
    ForcePosition law(mixed(Vector6::Ones(), cartesian));
    EXPECT_TRUE(law.tracks());
    Reference reference = pose_reference(fresh);
    law.start(fresh.cycle, reference);
    reference.cartesian.position += Vector3(0.02, 0.03, -0.02);
    Vector7 tau;
    for (int k = 0; k < 6000; ++k) {
      law.step(fresh.cycle, reference, tau);
      fresh.step(tau);
    }
    EXPECT_LT((fresh.cycle.O_T_EE.translation() - reference.cartesian.position).norm(), 1e-3) << cartesian;
  }
}

TEST_P(ForceControllers, the_estimate_at_K_is_moved_to_EE) {
  arm.state.EE_T_K[14] = 0.1;  // along z of EE
  arm.state.O_F_ext_hat_K = {1, 2, 3, 0.1, 0.2, 0.3};
  const Vector3 arm_of_force = 0.1 * arm.cycle.O_T_EE.linear().col(2);
  const Vector3 moment = Vector3(0.1, 0.2, 0.3) + arm_of_force.cross(Vector3(1, 2, 3));
  EXPECT_LT((felt_wrench(arm.cycle).tail<3>() - moment).norm(), 1e-12);
  arm.state.O_F_ext_hat_K[1] = std::nan("");
  EXPECT_EQ(felt_wrench(arm.cycle), Vector6::Zero());
}

// --- LQR -----------------------------------------------------------------------------------------------------------------

// Policy iteration, another way to the same equation: what the law costs over all cycles has it as its best law.
TEST_P(ForceControllers, the_gains_are_the_best_for_what_they_cost) {
  using Eigen::MatrixXd;
  const Lqr law(weights(), arm.model.mass());
  const Matrix7 M_inverse = Cholesky<7>(felt_inertia(arm.model.mass())).inverse();
  constexpr double T = 1e-3;
  MatrixXd A = MatrixXd::Identity(14, 14), B(14, 7), K(7, 14), Q = MatrixXd::Zero(14, 14);
  A.topRightCorner(7, 7).diagonal().setConstant(T);
  B << T * T / 2 * M_inverse, T * M_inverse;
  K << law.K(), law.D();
  Q.diagonal() << weights().position_weight, weights().velocity_weight;
  const MatrixXd R = weights().torque_weight.asDiagonal();
  MatrixXd step = A - B * K, P = Q + K.transpose() * R * K;
  for (int n = 0; n < 20; ++n) {
    P += step.transpose() * P * step;
    step = step * step;
  }
  EXPECT_LT(step.norm(), 1e-9) << "it is not stable";
  const MatrixXd best = Cholesky<7>(R + B.transpose() * P * B).inverse() * (B.transpose() * P * A);
  EXPECT_LT((best - K).norm(), 1e-6 * K.norm());
  const MatrixXd riccati = A.transpose() * P * A - A.transpose() * P * B * best + Q;
  EXPECT_LT((riccati - P).norm(), 1e-6 * P.norm());
  // Without weight on velocity a light joint has nearly the textbook's stiffness, sqrt(position_weight / torque_weight).
  EXPECT_NEAR(law.K()(0, 0), 600, 60);
}

TEST_P(ForceControllers, the_regulator_brings_the_arm_to_its_reference) {
  Lqr law(weights(), arm.model.mass());
  Reference reference = pose_reference(arm);
  reference.joint.q += vector(0.2);
  Vector7 tau;
  for (int k = 0; k < 4000; ++k) {
    law.step(arm.cycle, reference, tau);
    arm.step(tau);
  }
  EXPECT_LT((arm.q - reference.joint.q).norm(), 1e-4);
  EXPECT_LT(arm.dq.norm(), 1e-4);
}

// --- admittance ----------------------------------------------------------------------------------------------------------

TEST_P(ForceControllers, under_a_force_EE_moves_as_the_mass_would) {
  for (const double k : {0.0, 200.0}) {
    SimulatedArm fresh(GetParam(), kMotors);
    Admittance law(floating(k));
    EXPECT_EQ(law.tracks(), k > 0);
    Reference reference = pose_reference(fresh);
    law.start(fresh.cycle, reference);
    const Vector3 began = fresh.cycle.O_T_EE.translation();
    const Eigen::Quaterniond was(fresh.cycle.O_T_EE.linear());
    fresh.state.O_F_ext_hat_K = {0, -5, 0, 0, 0, 0.2};  // pulled to +y, turned to -z
    const double m = 10, d = 100, seconds = k > 0 ? 6 : 1;
    Vector7 tau;
    for (int n = 0; n < 1000 * seconds; ++n) {
      law.step(fresh.cycle, reference, tau);
      fresh.step(tau);
    }
    const double free = 5 / d * (seconds - m / d * (1 - std::exp(-d / m * seconds)));
    const double turned = 0.2 / 5 * (seconds - 0.1 * (1 - std::exp(-10 * seconds)));
    const Vector3 moved = fresh.cycle.O_T_EE.translation() - began;
    const Vector3 rotated = log(Eigen::Quaterniond(fresh.cycle.O_T_EE.linear()) * was.conjugate());
    EXPECT_NEAR(moved.y(), k > 0 ? 5 / k : free, 1e-3);
    EXPECT_NEAR(rotated.z(), k > 0 ? -0.2 / (k / 10) : -turned, 3e-3);
    EXPECT_LT(moved.head<1>().norm() + moved.tail<1>().norm(), 2e-3);
  }
}

// --- joint impedance -----------------------------------------------------------------------------------------------------

TEST_P(ForceControllers, critically_damped_joints_do_not_overshoot) {
  for (const double softer : {1.0, 0.2}) {
    SimulatedArm fresh(GetParam(), kMotors);
    JointImpedance law({softer * kStiffness, Vector7::Zero(), 1.0}, fresh.model.mass());
    Reference reference = pose_reference(fresh);
    law.start(fresh.cycle, reference);
    // Along one mode of the undamped arm, which a modal damping leaves one.
    const Cholesky<7> M(felt_inertia(fresh.model.mass()));
    const Matrix7 K = (softer * kStiffness).asDiagonal(), half = M.solve<7>(M.L());  // L^-T
    Vector7 way = half * SymmetricEigen<7>(half.transpose() * K * half).vectors.col(0);  // the slowest
    way *= 0.05 / way.cwiseAbs().maxCoeff();
    reference.joint.q += way;
    double beyond = 0, least_rise = 1;
    Vector7 tau;
    double last = 1;
    for (int k = 0; k < 4000; ++k) {
      law.step(fresh.cycle, reference, tau);
      fresh.step(tau);
      const double rest = (reference.joint.q - fresh.q).dot(way) / way.squaredNorm();
      beyond = std::max(beyond, -rest);
      if (k == 200) least_rise = last - rest;
      last = rest;
    }
    EXPECT_LT(beyond, 0.01);
    EXPECT_GT(least_rise, 0) << "and does not creep";
    EXPECT_LT((fresh.q - reference.joint.q).norm(), 1e-4);
  }
}

TEST_P(ForceControllers, energy_of_a_damped_arm_only_falls) {
  JointImpedance law({kStiffness, Vector7::Zero(), 0.3}, arm.model.mass());
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  arm.q += vector(0.1);
  arm.dq = vector(0.5);
  arm.observe();
  const auto energy = [&] {
    const Vector7 e = reference.joint.q - arm.q;
    return 0.5 * arm.dq.dot(felt_inertia(arm.model.mass()) * arm.dq) + 0.5 * e.dot(kStiffness.cwiseProduct(e));
  };
  const double all = energy();
  double before = all;
  Vector7 tau;
  for (int k = 0; k < 2000; ++k) {
    law.step(arm.cycle, reference, tau);
    arm.step(tau);
    EXPECT_LT(energy(), before + 0.003 * all);
    before = energy();
  }
  EXPECT_LT(before, 1e-3 * all);
}

TEST_P(ForceControllers, a_hand_feels_the_inertia_that_is_asked_for) {
  for (const double scale : {0.5, 2.0}) {
    SimulatedArm ideal(GetParam());
    JointImpedance::Parameters parameters{Vector7::Zero(), Vector7::Zero()};
    parameters.inertia_scale = scale;
    JointImpedance law(parameters);
    Reference reference = pose_reference(ideal);
    const Vector7 hand = vector(2);
    for (int i = 0; i < 7; ++i) ideal.state.tau_ext_hat_filtered[i] = -hand[i];
    Vector7 tau;
    law.start(ideal.cycle, reference);
    law.step(ideal.cycle, reference, tau);
    const Vector7 ddq = Cholesky<7>(ideal.model.mass()).solve<1>(tau + hand);
    EXPECT_LT((scale * (ideal.model.mass() * ddq) - hand).norm(), 1e-9);
  }
}

TEST_P(ForceControllers, an_integral_takes_away_what_a_load_leaves_and_is_bounded) {
  JointImpedance::Parameters parameters{kStiffness, kDamping};
  parameters.integral_rate = 3;
  parameters.integral_limit = 4;
  for (const double load : {3.0, 10.0}) {
    SimulatedArm fresh(GetParam(), kMotors);
    JointImpedance law(parameters, fresh.model.mass());
    Reference reference = pose_reference(fresh);
    law.start(fresh.cycle, reference);
    const Vector7 push = Vector7::Unit(3) * load;
    Vector7 tau;
    for (int k = 0; k < 6000; ++k) {
      law.step(fresh.cycle, reference, tau);
      fresh.step(tau, push);
    }
    const double expected = std::max(load - 4, 0.0) / kStiffness[3];
    EXPECT_NEAR(fresh.q[3] - reference.joint.q[3], expected, 1e-4);
  }
}

// The rule by its own loop: torque of the cycle before on an inertia.
TEST(JointInertia, what_is_refused_is_what_a_sampled_loop_cannot_hold) {
  std::mt19937 random(11);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<>(low, high)(random); };
  int refused = 0, accepted = 0;
  for (int n = 0; n < 2000; ++n) {
    const double m = std::exp(uniform(-4, 1)), T = 1e-3;
    const double D = m / T * uniform(0, 1.2), K = m / (T * T) * uniform(0, 0.4);
    Eigen::Matrix3d loop;  // q, v, torque
    loop << 1, T, T * T / m, 0, 1, T / m, -K, -D, 0;
    if (std::abs(D * T / m - 1) < 0.01) continue;
    for (int doubling = 0; doubling < 40; ++doubling) loop *= loop.eval();  // 2^40 cycles
    const bool stable = loop.norm() < 1;  // what does not fade grows beyond all numbers
    bool held = true;
    try {
      require_holdable(Vector7::Constant(K), Vector7::Constant(D), m * Matrix7::Identity());
    } catch (const std::invalid_argument&) {
      held = false;
    }
    EXPECT_EQ(held, stable) << "m " << m << ", K " << K << ", D " << D;
    ++(held ? accepted : refused);
  }
  EXPECT_GT(refused, 300);
  EXPECT_GT(accepted, 300);
}

using Loop21 = Eigen::Matrix<double, 21, 21>;

// What becomes of an arm of this mobility in 2^20 cycles, whose joints' springs answer a cycle late: less than 1 if it comes to rest.
double left_of(const Matrix7& mobility, const Vector7& K, const Vector7& D) {
  const double T = 1e-3;
  Loop21 loop = Loop21::Zero();  // q, v, torque
  loop.block<7, 7>(7, 7).setIdentity();
  loop.block<7, 7>(7, 14) = T * mobility;
  loop.topRows<7>() = T * loop.middleRows<7>(7);
  loop.block<7, 7>(0, 0).setIdentity();
  loop.block<7, 7>(14, 0) = -Matrix7(K.asDiagonal());
  loop.block<7, 7>(14, 7) = -Matrix7(D.asDiagonal());
  for (int doubling = 0; doubling < 20 && loop.norm() < 1e100; ++doubling) loop *= loop.eval();
  return loop.norm();
}

// Joints that each could be held alone may together not be: what one does reaches the others.
TEST_P(ForceControllers, springs_that_are_kept_holdable_hold_all_joints_together_anywhere) {
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<>(low, high)(random); };
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  int alone = 0;
  for (int n = 0; n < 300; ++n) {
    Vector7 q, K, D;
    for (int i = 0; i < 7; ++i) q[i] = uniform(limits.q_min[i], limits.q_max[i]);
    arm.model.update(q, Vector7::Zero());
    const Matrix7 mobility = joint_mobility(arm.model.mass());
    for (int i = 0; i < 7; ++i) {
      const double m = 1 / mobility(i, i), b = uniform(0.4, 0.95);
      D[i] = b * m / 1e-3;
      K[i] = uniform(0.1, 0.9) * m * b * (1 - b) / 1e-6;
    }
    alone += !(left_of(mobility, K, D) < 1);
    Vector7 held = K, damped = D;
    keep_holdable(mobility, held, damped);
    EXPECT_TRUE((held.array() <= (1 + 1e-9) * K.array()).all() && (damped.array() <= (1 + 1e-9) * D.array()).all());
    EXPECT_GT(held.minCoeff(), 0);
    EXPECT_GT(damped.minCoeff(), 0);
    EXPECT_LT(left_of(mobility, held, damped), 1e-3);
    EXPECT_NO_THROW(require_holdable(held, damped, felt_inertia(arm.model.mass())));
    const Vector7 same_K = held, same_D = damped;
    keep_holdable(mobility, held, damped);
    EXPECT_LT((held - same_K).norm() + (damped - same_D).norm(), 1e-9 * same_K.norm()) << "what is holdable stays as it is";
  }
  EXPECT_GT(alone, 100);
}

// Gains that are held at home, and where the arm is led are too hard for it: no oscillation.
TEST_P(ForceControllers, joints_that_are_held_stay_at_rest_also_where_they_show_less_inertia) {
  const Matrix7 mobility = joint_mobility(arm.model.mass());
  Vector7 K = Vector7::Constant(3000), D = Vector7::Constant(200);
  keep_holdable(mobility, K, D);
  PassThroughJointTorque::Parameters gains{Vector7::Zero(), Vector7::Zero(), Vector7::Zero(), 0.99 * K, 0.99 * D};
  PassThroughJointTorque held(gains, arm.model.mass());
  JointImpedance impedance({0.99 * K, 0.99 * D}, arm.model.mass());
  const Vector7 folded = (Vector7() << 0, -1.7, 0, -3.0, 0, 0.6, 0.8).finished();
  for (Controller* law : {static_cast<Controller*>(&held), static_cast<Controller*>(&impedance)}) {
    SimulatedArm there(GetParam(), kMotors);
    there.q = folded;
    there.observe();
    Reference reference;
    reference.motion = Channels::kJoint;
    reference.joint.q = folded;
    law->start(there.cycle, reference);
    there.dq = vector(0.01);
    there.observe();
    Vector7 tau;
    for (int k = 0; k < 3000; ++k) {
      law->step(there.cycle, reference, tau);
      there.step(tau);
    }
    EXPECT_LT(there.dq.norm(), 1e-3) << "moves on";
  }
}

// --- all of them ---------------------------------------------------------------------------------------------------------

// Up to what the loop fades away: a force or torque that the law cannot have had before.
TEST_P(ForceControllers, laws_with_a_spring_begin_with_the_torque_that_is_there) {
  arm.dq = vector(0.1);
  arm.tau = vector(1.5);
  arm.observe();
  for (auto& [name, law] : all_laws(arm)) {
    if (name != "Lqr" && name != "JointImpedance" && name != "Admittance") continue;
    Reference reference = pose_reference(arm);
    Vector7 tau;
    law->start(arm.cycle, reference);
    law->step(arm.cycle, reference, tau);
    EXPECT_LT((tau - arm.tau).norm(), 0.1) << name;
  }
}

TEST_P(ForceControllers, at_rest_without_a_wish_laws_ask_for_nothing) {
  for (auto& [name, law] : all_laws(arm)) {
    if (name == "HybridForcePosition" || name == "PassThroughJointTorque") continue;  // these have wishes of their own
    Reference reference = pose_reference(arm);
    Vector7 tau;
    law->start(arm.cycle, reference);
    law->step(arm.cycle, reference, tau);
    EXPECT_LT(tau.norm(), 1e-9) << name;
  }
}

TEST_P(ForceControllers, an_estimate_that_is_no_number_is_not_felt) {
  arm.state.O_F_ext_hat_K.fill(std::nan(""));
  arm.state.tau_ext_hat_filtered.fill(std::nan(""));
  for (auto& [name, law] : all_laws(arm)) {
    Reference reference = pose_reference(arm);
    Vector7 tau;
    law->start(arm.cycle, reference);
    law->step(arm.cycle, reference, tau);
    EXPECT_TRUE(tau.allFinite()) << name;
  }
}

TEST_P(ForceControllers, they_say_what_they_take) {
  for (auto& [name, law] : all_laws(arm)) {
    EXPECT_NE(motion_of(law->takes()), Channels::kNone) << name;
    const bool torque = name == "PassThroughJointTorque";
    const bool none = name == "Lqr" || name == "Admittance" || name == "JointImpedance";
    EXPECT_EQ(has(law->takes(), Channels::kTorque), torque) << name;
    EXPECT_EQ(has(law->takes(), Channels::kWrench), !torque && !none) << name;
    EXPECT_EQ(law->tracks(), name == "Lqr" || name == "JointImpedance") << name;
  }
}

TEST_P(ForceControllers, start_and_step_allocate_nothing) {
  if (!allocations::kCounts) GTEST_SKIP() << "the heap belongs to a sanitizer";
  auto laws = all_laws(arm);
  Reference reference = pose_reference(arm);
  Vector7 tau;
  const testing_tools::AllocationCounter allocations;
  for (int n = 0; n < 40; ++n) {
    for (auto& each : laws) {
      if (n == 0) each.controller->start(arm.cycle, reference);
      each.controller->step(arm.cycle, reference, tau);
    }
  }
  EXPECT_EQ(allocations.count(), 0);
}

TEST_P(ForceControllers, bad_fields_are_refused_by_name) {
  const auto expect = [](const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  const Matrix7 M = arm.model.mass();
  for (const double bad : {-1.0, 1e9, std::nan("")}) {
    expect(refusal([&] { PassThrough({bad, 0}); }), "max_translation is");
    expect(refusal([&] { PassThrough({0, bad}); }), "max_rotation is");
    expect(refusal([&] { ForceAxisImpedance(along_axis({0, 0, 1}, bad)); }), "max_translation is");
    auto torque = torques();
    torque.selection[2] = bad;
    expect(refusal([&] { PassThroughJointTorque(torque, M); }), "selection[2] is");
    auto both = mixed(Vector6::Ones(), true);
    both.force_kps_cart[1] = bad;
    expect(refusal([&] { ForcePosition{both}; }), "force_kps_cart[1] is");
    auto hybrid = pressing(0);
    hybrid.gain = bad;
    expect(refusal([&] { HybridForcePosition{hybrid}; }), "gain is");
    hybrid = pressing(0);
    hybrid.max_speed = bad;
    expect(refusal([&] { HybridForcePosition{hybrid}; }), "max_speed is");
    auto lqr = weights();
    lqr.torque_weight[4] = bad;
    expect(refusal([&] { Lqr(lqr, M); }), "torque_weight[4] is");
    auto light = floating(0);
    light.mass[0] = bad;
    expect(refusal([&] { Admittance{light}; }), "mass[0] is");
    JointImpedance::Parameters joint{kStiffness, kDamping};
    joint.damping_ratio = bad;
    expect(refusal([&] { JointImpedance{joint}; }), "damping_ratio is");
  }
  expect(refusal([&] { ForceAxisImpedance(along_axis({0, 0, 0})); }), "norm of axis is 0");
  auto half = pressing(0);
  half.force_axes[0] = 0.5;
  expect(refusal([&] { HybridForcePosition{half}; }), "force_axes[0] is 0.5");
  auto astray = pressing(0);
  astray.force[0] = 3;
  expect(refusal([&] { HybridForcePosition{astray}; }), "force[0] is 3");
  auto wild = weights();
  wild.position_weight.setConstant(1e8);
  wild.torque_weight.setConstant(1e-3);
  expect(refusal([&] { Lqr(wild, M); }), "not stable");
  // A wrist that is damped more, or stiffer, than a loop of 1 ms can be.
  JointImpedance::Parameters stiff{kStiffness, kDamping};
  EXPECT_EQ(refusal([&] { JointImpedance(stiff, M); }), "accepted");
  stiff.damping[6] = 200;
  expect(refusal([&] { JointImpedance(stiff, M); }), "damping[6] is 200");
  auto held = torques();
  held.damping.setConstant(200);
  expect(refusal([&] { PassThroughJointTorque(held, M); }), "damping[");
  stiff.damping[6] = 0.1;
  stiff.stiffness[6] = 3000;
  expect(refusal([&] { JointImpedance(stiff, M); }), "stiffness[6] is 3000");
}

}  // namespace
