#include "sim/robot/arm_model.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <random>

#include "models/joint_figures.hpp"
#include "tests/sim/arm_rig.hpp"

namespace sim {
namespace {

class ArmModelOf : public testing::TestWithParam<const char*> {
 protected:
  const models::Arm& arm = models::arm(GetParam());
  ArmModel model{arm};
  std::mt19937 random{1};

  Joints inside_limits() {
    const models::Limits& limits = models::limits(arm, 10);
    Joints q;
    for (int i = 0; i < 7; ++i) q[i] = std::uniform_real_distribution(limits.q_min[i], limits.q_max[i])(random);
    return q;
  }
  Joints any(double bound) {
    Joints v;
    for (double& x : v) x = std::uniform_real_distribution(-bound, bound)(random);
    return v;
  }
};

TEST_P(ArmModelOf, JacobianIsTheDerivativeOfThePose) {
  const Eigen::Vector3d F_p(0.02, -0.03, 0.1);
  for (int trial = 0; trial < 20; ++trial) {
    const Joints q = inside_limits();
    model.update_kinematics(q);
    const ArmModel::Matrix67 J = model.jacobian(F_p);
    for (int i = 0; i < 7; ++i) {
      constexpr double kStep = 1e-6;
      model.update_kinematics(q + kStep * Joints::Unit(i));
      const Eigen::Matrix4d after = model.O_T_F();
      model.update_kinematics(q - kStep * Joints::Unit(i));
      const Eigen::Matrix4d before = model.O_T_F();
      const Eigen::Vector4d p(F_p.x(), F_p.y(), F_p.z(), 1);
      const Eigen::Vector3d v = ((after - before) * p).head<3>() / (2 * kStep);
      const Eigen::Matrix3d S =
          (after - before).topLeftCorner<3, 3>() / (2 * kStep) * before.topLeftCorner<3, 3>().transpose();
      EXPECT_LT((J.col(i).head<3>() - v).norm(), 1e-8);
      EXPECT_LT((J.col(i).tail<3>() - Eigen::Vector3d(S(2, 1), S(0, 2), S(1, 0))).norm(), 1e-5);
    }
  }
}

TEST_P(ArmModelOf, MassIsSymmetricAndPositive) {
  for (int trial = 0; trial < 200; ++trial) {
    model.update(inside_limits(), Joints::Zero());
    const ArmModel::Matrix77& M = model.mass();
    EXPECT_EQ(M, M.transpose());
    EXPECT_EQ(M.llt().info(), Eigen::Success);
  }
}

// C dq = dM/dt dq - (1/2) d(dq^T M dq)/dq
TEST_P(ArmModelOf, CoriolisFollowsFromTheDerivativeOfMass) {
  for (int trial = 0; trial < 20; ++trial) {
    const Joints q = inside_limits(), dq = any(2);
    constexpr double kStep = 1e-5;
    Joints expected = Joints::Zero();
    for (int k = 0; k < 7; ++k) {
      model.update(q + kStep * Joints::Unit(k), dq);
      const ArmModel::Matrix77 after = model.mass();
      model.update(q - kStep * Joints::Unit(k), dq);
      const ArmModel::Matrix77 dM = (after - model.mass()) / (2 * kStep);
      expected += dq[k] * dM * dq;
      expected[k] -= 0.5 * dq.dot(dM * dq);
    }
    model.update(q, dq);
    EXPECT_LT((model.coriolis() - expected).norm(), 1e-7);
  }
}

// MuJoCo is an independent implementation of all of it.
TEST_P(ArmModelOf, AcceleratesAsThePhysicsDoes) {
  for (int trial = 0; trial < 20; ++trial) {
    World::Options options = ideal(arm);
    options.hand = false;
    options.q = array(0.6 * inside_limits() + 0.4 * joints(models::kHome));
    World world(options);
    for (int i = 0; i < 30; ++i) {
      const Joints tau = any(i < 20 ? 8 : 3);
      model.update(joints(world.truth().q), joints(world.truth().dq));
      ArmModel::Matrix77 M = model.mass();
      M.diagonal() += joints(models::kMotorInertia);
      const Joints ddq = M.llt().solve(tau - model.coriolis());
      world.step(array(tau + model.gravity()), {});
      ASSERT_LT((joints(world.truth().ddq) - ddq).norm(), 1e-7 * (1 + ddq.norm())) << "cycle " << i;
    }
  }
}

TEST_P(ArmModelOf, ToolIsABodyOnTheFlange) {
  // Two halves that are set together weigh and turn as the whole, wherever the flange is.
  const Joints q = inside_limits();
  const Eigen::Matrix3d I = Eigen::Vector3d(0.01, 0.02, 0.015).asDiagonal();
  model.update(q, Joints::Zero());
  const ArmModel::Matrix77 M0 = model.mass();
  const Joints g0 = model.gravity();
  const Eigen::Vector3d F_x_C(0.01, 0.02, 0.08);
  model.set_tool(1.5, F_x_C, I);
  model.update(q, Joints::Zero());
  const ArmModel::Matrix67 J = model.jacobian(F_x_C);
  const Eigen::Matrix3d R = model.O_T_F().topLeftCorner<3, 3>();
  const ArmModel::Matrix77 added = 1.5 * J.topRows<3>().transpose() * J.topRows<3>() +
                                   J.bottomRows<3>().transpose() * R * I * R.transpose() * J.bottomRows<3>();
  EXPECT_LT((model.mass() - M0 - added).norm(), 1e-12);
  EXPECT_LT((model.gravity() - g0 - 1.5 * 9.81 * J.row(2).transpose()).norm(), 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Arms, ArmModelOf, testing::Values("fer", "fr3", "fr3v2"),
                         [](const auto& info) { return std::string(info.param); });

}  // namespace
}  // namespace sim
