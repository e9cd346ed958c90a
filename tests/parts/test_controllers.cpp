#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <random>
#include <stdexcept>
#include <string>

#include "realtime/cholesky.hpp"
#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/controllers/free_drive.hpp"
#include "realtime/controllers/internal_impedance.hpp"
#include "realtime/controllers/joint_friction.hpp"
#include "realtime/controllers/joint_impedance.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/pose_joints.hpp"
#include "realtime/rotation.hpp"
#include "realtime/symmetric_eigen.hpp"
#include "tests/parts/joints.hpp"
#include "tests/parts/refusal.hpp"
#include "tests/realtime/allocation_counter.hpp"
#include "tests/realtime/simulated_arm.hpp"

namespace {

using realtime::against_friction;
using realtime::CartesianImpedance;
using realtime::felt_inertia;
using realtime::FreeDrive;
using realtime::Cholesky;
using realtime::InternalImpedance;
using realtime::JointImpedance;
using realtime::Matrix67;
using realtime::Matrix7;
using realtime::Reference;
using realtime::Channels;
using realtime::SymmetricEigen;
using realtime::Vector3;
using realtime::Vector6;
using realtime::Vector7;
using testing_tools::SimulatedArm;

// Of the size of real ones; kg m².

CartesianImpedance::Parameters soft() { return {Vector3::Constant(600), Vector3::Constant(50), 1, 10}; }
CartesianImpedance::Parameters stiff() { return {Vector3::Constant(3000), Vector3::Constant(300), 1, 100}; }

Reference joint_reference(const SimulatedArm& arm) {
  Reference reference;
  reference.joint.q = arm.q;
  return reference;
}

Eigen::Quaterniond orientation(const SimulatedArm& arm) { return Eigen::Quaterniond(arm.cycle.O_T_EE.linear()); }

double distance_to(const SimulatedArm& arm, const Reference& reference) {
  return (reference.cartesian.position - arm.cycle.O_T_EE.translation()).norm();
}
double angle_to(const SimulatedArm& arm, const Reference& reference) {
  return realtime::log(reference.cartesian.orientation * orientation(arm).conjugate()).norm();
}

void run(
    SimulatedArm& arm, realtime::Controller& law, const Reference& reference, double seconds,
    const std::function<void()>& each = [] {}, const Vector7& external = Vector7::Zero()) {
  Vector7 tau;
  for (int k = 0; k < seconds / SimulatedArm::kDt; ++k) {
    law.step(arm.cycle, reference, tau);
    arm.step(tau, external);
    each();
  }
}

class Controllers : public testing::TestWithParam<const char*> {
 protected:
  SimulatedArm arm{GetParam()};
  std::mt19937 random{3};
  double uniform(double low, double high) { return std::uniform_real_distribution<>(low, high)(random); }
  Vector7 vector(double size) {
    Vector7 out;
    for (int i = 0; i < 7; ++i) out[i] = uniform(-size, size);
    return out;
  }
  Vector3 direction() { return vector(1).head<3>().normalized(); }
};

INSTANTIATE_TEST_SUITE_P(Arms, Controllers, testing::Values("fer", "fr3"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(Controllers, at_rest_at_the_reference_no_torque_is_asked_for) {
  JointImpedance joint({kStiffness, kDamping});
  CartesianImpedance cartesian(soft());
  Reference q = joint_reference(arm), x = pose_reference(arm);
  Vector7 tau;
  joint.start(arm.cycle, q);
  joint.step(arm.cycle, q, tau);
  EXPECT_LT(tau.norm(), 1e-9);
  cartesian.start(arm.cycle, x);
  cartesian.step(arm.cycle, x, tau);
  EXPECT_LT(tau.norm(), 1e-9);
  EXPECT_LT(distance_to(arm, x), 1e-12);
}

// --- joint impedance -----------------------------------------------------------------------------

TEST_P(Controllers, joint_impedance_is_its_formula) {
  JointImpedance law({kStiffness, kDamping});
  for (int n = 0; n < 20; ++n) {
    arm.q += vector(0.1);
    arm.dq = vector(1);
    arm.observe();
    Reference reference = joint_reference(arm);
    reference.joint.q += vector(0.1);
    reference.joint.dq = vector(1);
    reference.joint.ddq = vector(5);
    Vector7 tau;
    law.step(arm.cycle, reference, tau);
    for (int i = 0; i < 7; ++i) {
      const double expected = kStiffness[i] * (reference.joint.q[i] - arm.q[i]) +
                              kDamping[i] * (reference.joint.dq[i] - arm.dq[i]) + arm.model.coriolis()[i] +
                              felt_inertia(arm.model.mass()).row(i).dot(reference.joint.ddq) +
                              against_friction(reference.joint.dq)[i];
      EXPECT_NEAR(tau[i], expected, 1e-10);
    }
  }
}

TEST_P(Controllers, friction_is_met_as_it_rises_from_rest_to_its_bound) {
  EXPECT_EQ(against_friction(Vector7::Zero()), Vector7::Zero());
  Vector7 last = Vector7::Zero();
  for (const double dq : {0.001, 0.01, 0.1, 1.0, 2.0}) {
    const Vector7 tau = against_friction(Vector7::Constant(dq));
    EXPECT_LT((against_friction(Vector7::Constant(-dq)) + tau).norm(), 1e-12) << "the same both ways";
    EXPECT_TRUE((tau.array() > last.array()).all());
    for (int i = 0; i < 7; ++i) EXPECT_LE(tau[i], models::kFrictionHeight[i] / 2);
    last = tau;
  }
}

TEST_P(Controllers, joint_impedance_brings_an_arm_with_motors_to_the_reference) {
  for (const double softer : {1.0, 0.1}) {
    SimulatedArm with_motors(GetParam(), kMotors);
    JointImpedance law({softer * kStiffness, std::sqrt(softer) * kDamping});
    Reference reference = joint_reference(with_motors);
    reference.joint.q += vector(0.3);
    run(with_motors, law, reference, 8);
    EXPECT_LT((with_motors.q - reference.joint.q).norm(), 1e-4);
    EXPECT_LT(with_motors.dq.norm(), 1e-4);
  }
}

TEST_P(Controllers, joint_impedance_is_stable_at_its_highest_stiffness) {
  SimulatedArm with_motors(GetParam(), kMotors);
  // Critical for the inertia of the joints; the wrist's is the motors' alone.
  const Vector7 inertia = with_motors.model.mass().diagonal() + kMotors;
  const Vector7 damping = (2 * (3000 * inertia.array()).sqrt()).min(200.0);
  JointImpedance law({Vector7::Constant(3000), damping});
  Reference reference = joint_reference(with_motors);
  reference.joint.q.array() += 0.02;
  run(with_motors, law, reference, 2);
  EXPECT_LT((with_motors.q - reference.joint.q).norm(), 1e-6);
  EXPECT_LT(with_motors.dq.norm(), 1e-6);
}

// Without feed-forward the error would be (M ddq + friction) / K: some 0.01 rad.
TEST_P(Controllers, joint_impedance_tracks_a_motion_by_feed_forward) {
  SimulatedArm arm(GetParam(), kMotors);
  arm.rubs = true;
  JointImpedance law({kStiffness, (Vector7() << 20, 20, 20, 20, 1, 1, 0.5).finished()});
  const Vector7 home = arm.q;
  double worst = 0;
  for (int k = 0; k < 3000; ++k) {
    const double t = k * SimulatedArm::kDt, w = 4;
    const Vector7 size = Vector7::Constant(0.15);
    Reference reference;
    // From rest: 1 - cos.
    reference.joint.q = home + size * (1 - std::cos(w * t));
    reference.joint.dq = size * w * std::sin(w * t);
    reference.joint.ddq = size * w * w * std::cos(w * t);
    Vector7 tau;
    law.step(arm.cycle, reference, tau);
    if (k > 1000) worst = std::max(worst, (reference.joint.q - arm.q).cwiseAbs().maxCoeff());
    arm.step(tau);
  }
  EXPECT_LT(worst, 2e-3);
}

TEST_P(Controllers, joint_impedance_takes_over_with_the_torque_it_finds) {
  for (const double stiffer : {0.2, 1.0, 5.0}) {
    arm.dq = vector(0.2);
    arm.tau = vector(4);
    arm.observe();
    JointImpedance law({stiffer * kStiffness, kDamping});
    Reference reference = joint_reference(arm);
    reference.joint.dq = arm.dq;
    reference.joint.ddq = vector(1);
    const Reference before = reference;
    Vector7 tau;
    law.start(arm.cycle, reference);
    law.step(arm.cycle, reference, tau);
    EXPECT_EQ(reference.joint.dq, before.joint.dq);
    EXPECT_EQ(reference.joint.ddq, before.joint.ddq);
    for (int i = 0; i < 7; ++i) {
      const double shift = std::abs(reference.joint.q[i] - before.joint.q[i]);
      EXPECT_LE(shift, 0.2 + 1e-12);  // as far as it may
      if (shift < 0.19) {
        EXPECT_NEAR(tau[i], arm.tau[i], 1e-9);
      }
    }
  }
}

// --- Cartesian impedance -------------------------------------------------------------------------

TEST_P(Controllers, a_force_at_EE_moves_it_by_force_over_stiffness) {
  for (const auto frame : {CartesianImpedance::Frame::kBase, CartesianImpedance::Frame::kEndEffector}) {
    SimulatedArm fresh(GetParam());
    CartesianImpedance::Parameters parameters = soft();
    parameters.translational_stiffness = Vector3(400, 600, 1000);
    parameters.rotational_stiffness = Vector3(30, 50, 60);
    parameters.frame = frame;
    CartesianImpedance law(parameters);
    Reference reference = pose_reference(fresh);
    law.start(fresh.cycle, reference);
    Vector6 wrench;  // in the axes of O
    wrench << 5, -4, -6, 0.5, -0.6, 0.4;
    Vector7 tau;
    for (int k = 0; k < 4000; ++k) {
      law.step(fresh.cycle, reference, tau);
      fresh.step(tau, fresh.model.jacobian().transpose() * wrench);
    }
    const bool base = frame == CartesianImpedance::Frame::kBase;
    const Eigen::Matrix3d R = base ? Eigen::Matrix3d::Identity() : Eigen::Matrix3d(fresh.cycle.O_T_EE.linear().transpose());
    const Vector3 force = R * wrench.head<3>(), torque = R * wrench.tail<3>();
    const Vector3 moved = R * (fresh.cycle.O_T_EE.translation() - reference.cartesian.position);
    const Vector3 turned = R * realtime::log(orientation(fresh) * reference.cartesian.orientation.conjugate());
    for (int i = 0; i < 3; ++i) {
      EXPECT_NEAR(moved[i], force[i] / parameters.translational_stiffness[i], 1e-6);
      EXPECT_NEAR(turned[i], torque[i] / parameters.rotational_stiffness[i], 1e-6);
    }
  }
}

TEST_P(Controllers, cartesian_impedance_comes_to_the_reference_without_overshoot) {
  for (const auto& parameters : {soft(), stiff()}) {
    SimulatedArm fresh(GetParam());
    CartesianImpedance law(parameters);
    Reference reference = pose_reference(fresh);
    law.start(fresh.cycle, reference);
    const Vector3 way(0.02, -0.03, 0.02);
    reference.cartesian.position += way;
    reference.cartesian.orientation = realtime::exp(Vector3(0.05, 0.1, -0.05)) * reference.cartesian.orientation;
    double beyond = 0;
    run(fresh, law, reference, 2, [&] {
      const Vector3 rest = reference.cartesian.position - fresh.cycle.O_T_EE.translation();
      beyond = std::max(beyond, -rest.dot(way) / way.squaredNorm());
    });
    EXPECT_LT(beyond, 0.03);
    EXPECT_LT(distance_to(fresh, reference), 1e-4);
    EXPECT_LT(angle_to(fresh, reference), 1e-3);
    EXPECT_LT(fresh.dq.norm(), 0.01);
  }
}

TEST_P(Controllers, cartesian_impedance_is_stable_at_its_highest_stiffness_with_and_without_motors) {
  for (const double ratio : {0.7, 1.0, 1.5, 3.0}) {
    for (const Vector7& motors : {Vector7(Vector7::Zero()), kMotors}) {
      SimulatedArm fresh(GetParam(), motors);
      CartesianImpedance::Parameters parameters = stiff();
      parameters.damping_ratio = ratio;
      CartesianImpedance law(parameters);
      Reference reference = pose_reference(fresh);
      law.start(fresh.cycle, reference);
      fresh.dq = vector(0.3);  // a push
      fresh.observe();
      run(fresh, law, reference, 4);
      EXPECT_LT(fresh.dq.norm(), 1e-3) << "damping ratio " << ratio << ", motors " << motors[0];
      EXPECT_LT(distance_to(fresh, reference), 1e-4);
      EXPECT_LT(angle_to(fresh, reference), 1e-3);
    }
  }
}

// Each logarithmic decrement of a mode with ratio 0.2 is 2 pi 0.2 / sqrt(1 - 0.04) = 1.28.
TEST_P(Controllers, the_damping_ratio_is_that_of_the_motion_of_EE) {
  CartesianImpedance::Parameters parameters = soft();
  parameters.damping_ratio = 0.2;
  CartesianImpedance law(parameters);
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);

  // Along one mode: an eigenvector of Lambda^-1 K, from rest.
  const Matrix67 J = arm.model.jacobian();
  const Eigen::Matrix<double, 6, 6> mobility = J * Cholesky<7>(arm.model.mass()).inverse() * J.transpose();
  Vector6 K;
  K << parameters.translational_stiffness, parameters.rotational_stiffness;
  const Eigen::Matrix<double, 6, 6> C = Cholesky<6>(mobility).L();
  const Vector6 mode = C * SymmetricEigen<6>(C.transpose() * K.asDiagonal() * C).vectors.col(0);  // the slowest
  const double scale = 2e-3 / mode.norm();
  reference.cartesian.position += scale * mode.head<3>();
  reference.cartesian.orientation = realtime::exp(scale * mode.tail<3>()) * reference.cartesian.orientation;

  std::vector<double> peaks;
  double before = 0, last = 0;
  run(arm, law, reference, 3, [&] {
    Vector6 e;
    e << reference.cartesian.position - arm.cycle.O_T_EE.translation(),
        realtime::log(reference.cartesian.orientation * orientation(arm).conjugate());
    const double along = e.dot(K.cwiseProduct(mode));
    if (std::abs(last) > std::abs(before) && std::abs(last) > std::abs(along)) peaks.push_back(std::abs(last));
    before = last;
    last = along;
  });
  ASSERT_GE(peaks.size(), 3u);
  const double decrement = std::log(peaks[0] / peaks[1]);  // half a period
  EXPECT_NEAR(decrement, M_PI * 0.2 / std::sqrt(1 - 0.04), 0.06);
}

TEST_P(Controllers, orientation_is_reached_the_shortest_way_also_beyond_90_degrees) {
  for (const double angle : {1.2, 2.0, 2.6, 3.1}) {
    SimulatedArm fresh(GetParam());
    CartesianImpedance law({Vector3::Constant(600), Vector3::Constant(20), 1, 10});
    Reference reference = pose_reference(fresh);
    law.start(fresh.cycle, reference);
    // About the flange's own axis, which joint 7 does.
    const Vector3 axis = fresh.cycle.O_T_EE.linear().col(2);
    const double sign = fresh.q[6] > 0 ? 1 : -1;
    reference.cartesian.orientation = realtime::exp(sign * angle * axis) * reference.cartesian.orientation;
    reference.cartesian.orientation.coeffs() *= -1;  // the same rotation
    const Eigen::Quaterniond start = orientation(fresh);
    double furthest = 0, wrong_way = 0;
    run(fresh, law, reference, 4, [&] {
      furthest = std::max(furthest, angle_to(fresh, reference));
      const Vector3 turned = realtime::log(orientation(fresh) * start.conjugate());
      if (turned.norm() < 2.5) wrong_way = std::max(wrong_way, -sign * turned.dot(axis));
    });
    EXPECT_LT(angle_to(fresh, reference), 0.01) << "from " << angle;
    EXPECT_LE(furthest, angle + 1e-6) << "turned away";
    EXPECT_LT(wrong_way, 0.01);
  }
}

TEST_P(Controllers, cartesian_impedance_tracks_a_motion_by_feed_forward) {
  CartesianImpedance law(soft());
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  const Reference home = reference;
  const Vector3 axis = Vector3(1, 2, -1).normalized();
  double worst = 0, worst_angle = 0;
  for (int k = 0; k < 3000; ++k) {
    const double t = k * SimulatedArm::kDt, w = 3;
    const Vector3 size(0.05, 0.08, -0.04);
    auto& pose = reference.cartesian;
    pose.position = home.cartesian.position + size * (1 - std::cos(w * t));
    pose.orientation = realtime::exp(0.15 * (1 - std::cos(w * t)) * axis) * home.cartesian.orientation;
    pose.velocity << size * w * std::sin(w * t), 0.15 * w * std::sin(w * t) * axis;
    pose.acceleration << size * w * w * std::cos(w * t), 0.15 * w * w * std::cos(w * t) * axis;
    Vector7 tau;
    law.step(arm.cycle, reference, tau);
    if (k > 1000) {
      worst = std::max(worst, distance_to(arm, reference));
      worst_angle = std::max(worst_angle, angle_to(arm, reference));
    }
    arm.step(tau);
  }
  EXPECT_LT(worst, 2e-3);
  EXPECT_LT(worst_angle, 6e-3);
}

TEST_P(Controllers, the_null_space_returns_to_its_posture_and_leaves_EE_alone) {
  CartesianImpedance law({Vector3::Constant(2000), Vector3::Constant(200), 1, 20});
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  const Vector7 posture = arm.q;

  // Along the self-motion, by the posture's own Jacobian.
  for (int k = 0; k < 400; ++k) {
    const Eigen::FullPivLU<Matrix67> lu(arm.model.jacobian());
    Vector7 n = lu.kernel().col(0).normalized();
    if (n[2] < 0) n = -n;
    arm.q += 1e-3 * n;
    arm.observe();
  }
  reference = pose_reference(arm);
  const double away = (arm.q - posture).norm();
  ASSERT_GT(away, 0.3);
  double moved = 0;
  run(arm, law, reference, 6, [&] { moved = std::max(moved, distance_to(arm, reference)); });
  EXPECT_LT((arm.q - posture).norm(), 0.1 * away);
  EXPECT_LT(moved, 1e-3);
}

TEST_P(Controllers, null_space_torque_does_not_accelerate_EE) {
  CartesianImpedance::Parameters with = soft(), without = soft();
  with.nullspace_stiffness = 100;
  without.nullspace_stiffness = 0;
  CartesianImpedance a(with), b(without);
  Reference reference = pose_reference(arm);
  Reference same = reference;
  a.start(arm.cycle, reference);
  b.start(arm.cycle, same);
  for (int n = 0; n < 20; ++n) {
    arm.q += vector(0.1);
    arm.dq.setZero();
    arm.observe();
    Vector7 tau_a, tau_b;
    a.step(arm.cycle, reference, tau_a);
    b.step(arm.cycle, reference, tau_b);
    const Vector7 torque = tau_a - tau_b;
    const Vector6 acceleration = arm.model.jacobian() * Cholesky<7>(arm.model.mass()).solve(torque);
    // The small share is that of the least mobility, which keeps singular postures finite.
    EXPECT_LT(acceleration.norm(), 2e-2 * torque.norm());
  }
}

TEST_P(Controllers, cartesian_impedance_takes_over_with_the_torque_it_finds) {
  for (int n = 0; n < 50; ++n) {
    SimulatedArm fresh(GetParam());
    fresh.q += vector(0.2);
    fresh.dq = vector(0.1);
    fresh.tau = vector(2);
    fresh.observe();
    CartesianImpedance law({Vector3::Constant(uniform(500, 3000)), Vector3::Constant(uniform(50, 300)), 1, 50});
    Reference reference = pose_reference(fresh);
    reference.cartesian.velocity = fresh.model.jacobian() * fresh.dq;
    const Reference before = reference;
    law.start(fresh.cycle, reference);
    Vector7 tau;
    law.step(fresh.cycle, reference, tau);
    // A tenth of what the torque may change in a cycle; in a singular direction the law lacks a part.
    EXPECT_LT((tau - fresh.tau).cwiseAbs().maxCoeff(), 0.1) << tau.transpose() << "\n" << fresh.tau.transpose();
    EXPECT_EQ(reference.cartesian.velocity, before.cartesian.velocity);
  }
}

// The whole change as the loop makes it: torque of the law before, then start() of the next.
TEST_P(Controllers, from_joint_to_cartesian_impedance_and_back_the_torque_does_not_jump) {
  SimulatedArm with_motors(GetParam(), kMotors);
  JointImpedance joint({kStiffness, kDamping});
  Reference q = joint_reference(with_motors);
  q.joint.q += vector(0.01);
  Vector7 push = Vector7::Zero();
  push << 2, -3, 1, 2, 0.5, -0.5, 0.2;
  run(
      with_motors, joint, q, 3, [] {}, push);
  const Vector7 held = with_motors.tau;
  EXPECT_LT((held + push).norm(), 0.05);

  CartesianImpedance cartesian(soft());
  Reference x = pose_reference(with_motors);
  cartesian.start(with_motors.cycle, x);
  Vector7 tau;
  cartesian.step(with_motors.cycle, x, tau);
  EXPECT_LT((tau - held).cwiseAbs().maxCoeff(), 0.05);
  // The null space yields to the push, back towards its posture.
  run(
      with_motors, cartesian, x, 8, [] {}, push);
  EXPECT_LT(with_motors.dq.norm(), 1e-3);

  JointImpedance soft_joint({0.5 * kStiffness, kDamping});
  q = joint_reference(with_motors);
  const Vector7 last = with_motors.tau;
  soft_joint.start(with_motors.cycle, q);
  soft_joint.step(with_motors.cycle, q, tau);
  EXPECT_LT((tau - last).cwiseAbs().maxCoeff(), 0.05);
}

TEST_P(Controllers, a_singular_posture_asks_for_finite_torque_and_is_left) {
  arm.q << 0, 0, 0, -0.08, 0, 0.5, 0;  // nearly stretched
  arm.observe();
  CartesianImpedance law(soft());
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  reference.cartesian.position -= Vector3(0, 0, 0.1);
  double most = 0;
  run(arm, law, reference, 4, [&] { most = std::max(most, arm.tau.cwiseAbs().maxCoeff()); });
  EXPECT_LT(most, 87);
  EXPECT_TRUE(arm.q.allFinite());
  EXPECT_LT(distance_to(arm, reference), 0.02);
}

TEST_P(Controllers, an_axis_without_stiffness_is_free) {
  CartesianImpedance law({Vector3(600, 600, 0), Vector3::Constant(50), 1, 10});
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  const Reference home = reference;
  reference.cartesian.position.z() += 0.3;
  Vector7 tau;
  law.step(arm.cycle, reference, tau);
  EXPECT_LT(tau.norm(), 1e-9);
  reference = home;
  law.start(arm.cycle, reference);
  EXPECT_EQ(reference.cartesian.position.z(), home.cartesian.position.z());
}

// --- its integral ----------------------------------------------------------------------------------

CartesianImpedance::Parameters integrating(double rate) {
  CartesianImpedance::Parameters parameters = soft();
  parameters.integral_rate = rate;
  parameters.integral_limit << Vector3::Constant(20), Vector3::Constant(5);
  return parameters;
}

Vector7 push_of(const SimulatedArm& arm, const Vector6& wrench) { return arm.model.jacobian().transpose() * wrench; }

TEST_P(Controllers, an_integral_takes_away_what_a_load_leaves_of_the_way_as_far_as_its_limit) {
  Vector6 load;
  load << 3, -4, -12, 0.5, -0.6, 0.4;
  for (const auto frame : {CartesianImpedance::Frame::kBase, CartesianImpedance::Frame::kEndEffector}) {
    for (const double times : {1.0, 4.0}) {
      SimulatedArm fresh(GetParam(), kMotors);
      CartesianImpedance::Parameters parameters = integrating(3);
      parameters.frame = frame;
      CartesianImpedance law(parameters);
      const Reference reference = pose_reference(fresh);
      Reference moved = reference;
      law.start(fresh.cycle, moved);
      Vector7 tau;
      for (int k = 0; k < 8000; ++k) {
        law.step(fresh.cycle, reference, tau);
        fresh.step(tau, push_of(fresh, times * load));
      }
      EXPECT_LT(fresh.dq.norm(), 1e-3);
      if (times == 1) {
        EXPECT_LT(distance_to(fresh, reference), 1e-4);
        EXPECT_LT(angle_to(fresh, reference), 1e-3);
      } else if (frame == CartesianImpedance::Frame::kBase) {
        EXPECT_NEAR(reference.cartesian.position.z() - fresh.cycle.O_T_EE.translation().z(), (4 * 12 - 20) / 600., 1e-4);
      }
    }
  }
}

TEST_P(Controllers, an_integral_is_stable_at_its_fastest_on_any_spring) {
  using Stiffness = std::pair<double, double>;
  for (const auto& [K, K_rotation] : {Stiffness(600, 50), Stiffness(60, 5), Stiffness(6, 0.5), Stiffness(2000, 2), Stiffness(10, 200)}) {
    for (const double ratio : {0.3, 1.0}) {
      SimulatedArm fresh(GetParam(), kMotors);
      CartesianImpedance::Parameters parameters = integrating(10);
      parameters.translational_stiffness.setConstant(K);
      parameters.rotational_stiffness.setConstant(K_rotation);
      parameters.damping_ratio = ratio;
      CartesianImpedance law(parameters);
      Reference reference = pose_reference(fresh);
      law.start(fresh.cycle, reference);
      reference.cartesian.position += Vector3(0.01, -0.01, 0.01);
      run(fresh, law, reference, 40);
      EXPECT_LT(fresh.dq.norm(), 2e-3) << K << ", " << K_rotation << ", " << ratio;
      EXPECT_LT(distance_to(fresh, reference), 1e-3) << K << ", " << K_rotation << ", " << ratio;
    }
  }
}

TEST_P(Controllers, an_integral_does_not_grow_while_another_torque_leaves_than_is_asked_for) {
  for (const bool limited : {false, true}) {
    CartesianImpedance law(integrating(2));
    Reference reference = pose_reference(arm);
    law.start(arm.cycle, reference);
    reference.cartesian.position.x() += 0.01;
    Vector7 tau, first;
    for (int k = 0; k <= 500; ++k) {
      law.step(arm.cycle, reference, tau);
      if (k == 0) first = tau;
      arm.cycle.tau_J_d = limited ? Vector7(0.5 * tau) : tau;
    }
    const Vector7 grown = push_of(arm, 2 * 0.5 * 0.01 * 600 * Vector6::Unit(0));
    EXPECT_LT((tau - first - (limited ? 0 : 1) * grown).norm(), 0.02 * grown.norm());
  }
}

// What the integral of the law before exerts is not let go when its gains are changed.
TEST_P(Controllers, a_law_with_an_integral_takes_over_from_another_without_a_step_or_a_sag) {
  SimulatedArm fresh(GetParam(), kMotors);
  const Reference reference = pose_reference(fresh);
  CartesianImpedance law(integrating(3));
  Reference unmoved = reference;
  law.start(fresh.cycle, unmoved);
  Vector6 load;
  load << 3, -4, -12, 0.5, -0.6, 0.4;
  Vector7 tau;
  const auto drive = [&](CartesianImpedance& by, double seconds) {
    double farthest = 0;
    for (int k = 0; k < seconds / SimulatedArm::kDt; ++k) {
      by.step(fresh.cycle, reference, tau);
      fresh.step(tau, push_of(fresh, load));
      farthest = std::max(farthest, distance_to(fresh, reference));
    }
    return farthest;
  };
  drive(law, 8);
  for (const double stiffer : {4.0, 0.25}) {
    CartesianImpedance::Parameters parameters = integrating(1);
    parameters.translational_stiffness *= stiffer;
    CartesianImpedance next(parameters);
    unmoved = reference;
    next.start(fresh.cycle, unmoved);
    EXPECT_LT((unmoved.cartesian.position - reference.cartesian.position).norm(), 1e-4);
    next.step(fresh.cycle, reference, tau);
    EXPECT_LT((tau - fresh.tau).cwiseAbs().maxCoeff(), 0.05);
    EXPECT_LT(drive(next, 2), 2e-3);
  }
}

// --- a posture ---------------------------------------------------------------------------------------

TEST_P(Controllers, the_arm_is_led_near_a_posture_while_EE_stays) {
  SimulatedArm fresh(GetParam(), kMotors);
  const auto& limits = models::limits(models::arm(GetParam()), 10);
  const Vector7 posture = fresh.q + 0.4 * fresh.model.joints_of_pose(fresh.q).null_motion;
  CartesianImpedance::Parameters parameters{Vector3::Constant(2000), Vector3::Constant(200), 1, 50};
  parameters.posture = posture;
  CartesianImpedance law(parameters);
  ASSERT_EQ(law.posture(), posture);
  realtime::PoseJoints joints(fresh.model, limits);
  joints.place(fresh.q);
  joints.prefer(law.posture());
  Reference reference = pose_reference(fresh);
  law.start(fresh.cycle, reference);
  const Vector7 home = fresh.q;
  double moved = 0, fastest = 0, step = 0;
  Vector7 tau;
  for (int k = 0; k < 15000; ++k) {
    joints.step(reference.cartesian, SimulatedArm::kDt);
    fresh.cycle.q_ref = joints.joints().q;
    law.step(fresh.cycle, reference, tau);
    step = std::max(step, (tau - fresh.tau).cwiseAbs().maxCoeff());
    fresh.step(tau);
    moved = std::max(moved, distance_to(fresh, reference));
    fastest = std::max(fastest, std::abs(fresh.dq[2]));
  }
  EXPECT_GT(fresh.q[2] - home[2], 0.3);
  EXPECT_LT((fresh.q - fresh.cycle.q_ref).norm(), 0.01);
  // As near as it is with EE where it is: what is left is across the elbow's motion.
  const Vector7 n = Eigen::FullPivLU<Matrix67>(fresh.model.jacobian()).kernel().col(0).normalized();
  EXPECT_LT(std::abs(n.dot(posture - fresh.q)), 0.02);
  EXPECT_LT(moved, 1e-3);
  EXPECT_LT(fastest, 0.15);
  EXPECT_LT(step, 0.1);
}

TEST_P(Controllers, the_elbow_stops_before_a_joint_is_at_its_end) {
  const auto& limits = models::limits(models::arm(GetParam()), 10);
  for (const double side : {-1.0, 1.0}) {
    realtime::PoseJoints joints(arm.model, limits);
    joints.place(arm.q);
    // No posture for that pose: all joints at the ends of their ranges to which the elbow's motion takes them.
    const Vector7 n = side * arm.model.joints_of_pose(arm.q).null_motion;
    joints.prefer(Vector7((n.array() > 0).select(Vector7::Map(limits.q_max.data()), Vector7::Map(limits.q_min.data()))));
    const Reference reference = pose_reference(arm);
    for (int k = 0; k < 60000; ++k) {
      joints.step(reference.cartesian, SimulatedArm::kDt);
      const Vector7& q = joints.joints().q;
      for (int i = 0; i < 7; ++i) {
        ASSERT_GT(q[i], limits.q_min[i]) << i;
        ASSERT_LT(q[i], limits.q_max[i]) << i;
      }
    }
    EXPECT_GT((joints.joints().q - arm.q).norm(), 0.5);
  }
}

// --- internal impedance --------------------------------------------------------------------------

TEST(InternalImpedance, the_robot_controller_follows_from_stiffness_and_reference) {
  using fci::ControllerMode, fci::MotionGeneratorMode;
  const InternalImpedance plain({}), joint({Vector7(Vector7::Constant(100)), {}}),
      cartesian({{}, Vector6(Vector6::Constant(200))});
  const auto mode = [](const InternalImpedance& law, Channels kind) { return law.mode(kind); };
  EXPECT_EQ(mode(plain, Channels::kJoint),
            (robot::Mode{ControllerMode::kJointImpedance, MotionGeneratorMode::kJointPosition}));
  EXPECT_EQ(mode(joint, Channels::kPose),
            (robot::Mode{ControllerMode::kJointImpedance, MotionGeneratorMode::kCartesianPosition}));
  EXPECT_EQ(mode(cartesian, Channels::kJoint),
            (robot::Mode{ControllerMode::kCartesianImpedance, MotionGeneratorMode::kJointPosition}));
  EXPECT_EQ(mode(cartesian, Channels::kPose),
            (robot::Mode{ControllerMode::kCartesianImpedance, MotionGeneratorMode::kCartesianPosition}));

  EXPECT_EQ(joint.settings().joint_impedance->K_theta, (fci::Vector7{100, 100, 100, 100, 100, 100, 100}));
  EXPECT_FALSE(joint.settings().cartesian_impedance);
  EXPECT_EQ(cartesian.settings().cartesian_impedance->K_x, (fci::Vector6{200, 200, 200, 200, 200, 200}));
  EXPECT_FALSE(cartesian.settings().joint_impedance);
  EXPECT_EQ(plain.settings().joint_impedance->K_theta, (fci::Vector7{3000, 3000, 3000, 2500, 2500, 2000, 2000}));
}

// --- what is refused -----------------------------------------------------------------------------

TEST(ControllerParameters, each_bad_field_is_refused_by_name) {
  const auto expect = [](const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  for (const double bad : {-1.0, 3001.0, std::nan(""), double{INFINITY}}) {
    for (int i = 0; i < 7; ++i) {
      const std::string at = "[" + std::to_string(i) + "] is ";
      Vector7 wrong = kStiffness;
      wrong[i] = bad;
      expect(refusal([&] { JointImpedance({wrong, kDamping}); }), "stiffness" + at);
      Vector7 damping = kDamping;
      damping[i] = bad;
      expect(refusal([&] { JointImpedance({kStiffness, damping}); }), "damping" + at);
      wrong[i] = bad > 0 ? 20000 : bad;
      expect(refusal([&] { InternalImpedance({wrong, {}}); }), "K_theta" + at);
      if (i >= 6) continue;
      Vector6 K_x = Vector6::Constant(100);
      K_x[i] = bad;
      expect(refusal([&] { InternalImpedance({{}, K_x}); }), "K_x" + at);
    }
    for (int i = 0; i < 3; ++i) {
      const std::string at = "[" + std::to_string(i) + "] is ";
      auto translation = soft(), rotation = soft();
      translation.translational_stiffness[i] = bad;
      rotation.rotational_stiffness[i] = bad;
      expect(refusal([&] { CartesianImpedance{translation}; }), "translational_stiffness" + at);
      expect(refusal([&] { CartesianImpedance{rotation}; }), "rotational_stiffness" + at);
    }
    auto ratio = soft(), nullspace = soft();
    ratio.damping_ratio = bad;
    nullspace.nullspace_stiffness = bad;
    expect(refusal([&] { CartesianImpedance{ratio}; }), "damping_ratio is ");
    expect(refusal([&] { CartesianImpedance{nullspace}; }), "nullspace_stiffness is ");
    expect(refusal([&] { CartesianImpedance{integrating(bad)}; }), "integral_rate is ");
    for (int i = 0; i < 6; ++i) {
      auto limit = integrating(1);
      limit.integral_limit[i] = bad;
      expect(refusal([&] { CartesianImpedance{limit}; }), "integral_limit[" + std::to_string(i) + "] is ");
    }
  }
  auto limp = soft();
  limp.nullspace_stiffness = 0;
  limp.posture = Vector7(Vector7::Zero());
  expect(refusal([&] { CartesianImpedance{limp}; }), "posture");
  Vector6 soft_x = Vector6::Constant(100);
  soft_x[1] = 5;
  expect(refusal([&] { InternalImpedance({{}, soft_x}); }), "K_x[1] is 5");
  expect(refusal([&] { InternalImpedance({kStiffness, Vector6(Vector6::Constant(100))}); }), "K_theta and K_x");
}

// --- free drive ------------------------------------------------------------------------------------

TEST_P(Controllers, free_drive_holds_what_pushes_less_than_its_friction_and_lets_go_of_what_pushes_more) {
  const Vector7 friction = (Vector7() << 0.6, 0.6, 0.6, 0.6, 0.2, 0.2, 0.2).finished();
  for (int joint : {0, 3, 6}) {
    for (const double share : {0.8, 3.0}) {
      SimulatedArm fresh(GetParam(), kMotors);
      FreeDrive law({Vector7::Zero(), friction});
      Reference reference = joint_reference(fresh);
      law.start(fresh.cycle, reference);
      const Vector7 q = fresh.q;
      double most = 0;
      const auto watch = [&] { most = std::max(most, (fresh.tau - fresh.cycle.model.coriolis()).cwiseQuotient(friction).cwiseAbs().maxCoeff()); };
      run(fresh, law, reference, 0.5, watch, share * friction[joint] * Vector7::Unit(joint));
      EXPECT_LT(most, 1.01);  // Coriolis torques are those of a cycle before
      if (share < 1) {
        EXPECT_LT((fresh.q - q).cwiseAbs().maxCoeff(), 0.6 / 100);
        EXPECT_LT(fresh.dq.norm(), 0.01);
      } else {
        EXPECT_GT(fresh.q[joint] - q[joint], 0.05);
        EXPECT_GT(fresh.dq[joint], 0.1);
      }
      // Left alone it comes to rest, and stays.
      run(fresh, law, reference, 4);
      const Vector7 rest = fresh.q;
      run(fresh, law, reference, 1);
      EXPECT_LT((fresh.q - rest).norm(), 1e-4) << "joint " << joint << ", " << share;
    }
  }
}

TEST_P(Controllers, start_and_step_allocate_nothing) {
  if (!allocations::kCounts) GTEST_SKIP() << "the heap belongs to a sanitizer";
  JointImpedance joint({kStiffness, kDamping});
  CartesianImpedance cartesian(integrating(1));
  Reference q = joint_reference(arm), x = pose_reference(arm);
  Vector7 tau;
  const testing_tools::AllocationCounter allocations;
  for (int n = 0; n < 100; ++n) {
    joint.start(arm.cycle, q);
    joint.step(arm.cycle, q, tau);
    cartesian.start(arm.cycle, x);
    cartesian.step(arm.cycle, x, tau);
  }
  EXPECT_EQ(allocations.count(), 0);
}

}  // namespace
