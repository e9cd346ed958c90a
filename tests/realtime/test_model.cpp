#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <random>
#include <string>

#include "allocation_counter.hpp"
#include "models/arm.hpp"
#include "realtime/model.hpp"
#include "realtime/rotation.hpp"

namespace {

using realtime::Matrix67;
using realtime::Matrix7;
using realtime::Model;
using realtime::Vector3;
using realtime::Vector6;
using realtime::Vector7;

std::string replaced(std::string text, const std::string& all, const std::string& by) {
  for (std::size_t at = 0; (at = text.find(all, at)) != std::string::npos; at += by.size()) text.replace(at, all.size(), by);
  return text;
}

// Franka's Denavit-Hartenberg parameters in Craig's convention, the flange last.
struct Row {
  double a, d, alpha;
};
constexpr std::array<Row, 8> kRows = {{{0, 0.333, 0},
                                       {0, 0, -M_PI_2},
                                       {0, 0.316, M_PI_2},
                                       {0.0825, 0, M_PI_2},
                                       {-0.0825, 0.384, -M_PI_2},
                                       {0, 0, M_PI_2},
                                       {0.088, 0, M_PI_2},
                                       {0, 0.107, 0}}};

// Frames of link1..link7 and the flange.
std::array<Eigen::Isometry3d, 8> frames(const Vector7& q) {
  std::array<Eigen::Isometry3d, 8> out;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  for (int i = 0; i < 8; ++i) {
    T = T * Eigen::AngleAxisd(kRows[i].alpha, Vector3::UnitX()) * Eigen::Translation3d(kRows[i].a, 0, 0) *
        Eigen::Translation3d(0, 0, kRows[i].d) * Eigen::AngleAxisd(i < 7 ? q[i] : 0, Vector3::UnitZ());
    out[i] = T;
  }
  return out;
}

struct Tool {
  double mass = 1.1;
  Vector3 com = Vector3(0.02, -0.03, 0.07);
  Eigen::Matrix3d inertia = Vector3(0.004, 0.003, 0.002).asDiagonal();
  Eigen::Isometry3d F_T_EE = Eigen::Translation3d(0.01, 0.02, 0.1034) * Eigen::AngleAxisd(-0.7, Vector3::UnitZ());
};

// Kinetic energy (J) of links and tool by differences of their frames along dq; twice that is dq' M dq.
double kinetic_energy(const models::Arm& arm, const Tool& tool, const Vector7& q, const Vector7& dq) {
  constexpr double h = 1e-6;
  const auto before = frames(q - h * dq), after = frames(q + h * dq), at = frames(q);
  double energy = 0;
  const auto add = [&](int frame, double mass, const Vector3& com, const Eigen::Matrix3d& I) {
    const Vector3 v = (after[frame] * com - before[frame] * com) / (2 * h);
    const Eigen::AngleAxisd turn(after[frame].linear() * before[frame].linear().transpose());
    const Vector3 w = at[frame].linear().transpose() * (turn.axis() * turn.angle() / (2 * h));
    energy += 0.5 * mass * v.squaredNorm() + 0.5 * w.dot(I * w);
  };
  for (int i = 0; i < 7; ++i) {
    const models::Link& link = arm.links[i + 1];
    const auto& I = link.inertia;
    add(i, link.mass, Vector3::Map(link.com.data()),
        (Eigen::Matrix3d() << I[0], I[3], I[4], I[3], I[1], I[5], I[4], I[5], I[2]).finished());
  }
  add(7, tool.mass, tool.com, tool.inertia);
  return energy;
}

class ModelOf : public testing::TestWithParam<const char*> {
 protected:
  const models::Arm& arm = models::arm(GetParam());
  Model model{models::urdf(arm, 10)};
  Tool tool;
  Vector7 q, dq;

  void SetUp() override {
    model.set_tool(tool.mass, tool.com, tool.inertia, tool.F_T_EE);
    std::srand(7);
  }
  void anywhere() {
    q = 2 * Vector7::Random();
    dq = 2 * Vector7::Random();
    model.update(q, dq);
  }
  Matrix7 mass_at(const Vector7& at) {
    model.update(at, Vector7::Zero());
    return model.mass();
  }
};

INSTANTIATE_TEST_SUITE_P(Arms, ModelOf, testing::Values("fer", "fr3", "fr3v2"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(ModelOf, has_the_kinematics_of_the_published_parameters) {
  for (int n = 0; n < 20; ++n) {
    anywhere();
    const Eigen::Isometry3d expected = frames(q)[7] * tool.F_T_EE;
    EXPECT_TRUE(model.O_T_EE().isApprox(expected, 1e-12));
    EXPECT_TRUE(model.O_T_EE(q).isApprox(expected, 1e-12));
  }
}

TEST_P(ModelOf, kinematics_of_another_posture_leave_the_rest_alone) {
  anywhere();
  const Eigen::Isometry3d T = model.O_T_EE();
  const Matrix67 J = model.jacobian();
  model.O_T_EE(q + Vector7::Ones());
  EXPECT_EQ(model.O_T_EE().matrix(), T.matrix());
  EXPECT_EQ(model.jacobian(), J);
}

TEST_P(ModelOf, jacobian_and_its_derivative_are_those_of_the_kinematics) {
  constexpr double h = 1e-5;
  for (int n = 0; n < 20; ++n) {
    anywhere();
    const Matrix67 J = model.jacobian();
    const Vector6 dJ_dq = model.dJ_dq();
    for (int i = 0; i < 7; ++i) {
      const Eigen::Isometry3d a = model.O_T_EE(q - h * Vector7::Unit(i)), b = model.O_T_EE(q + h * Vector7::Unit(i));
      Vector6 column;
      column << (b.translation() - a.translation()) / (2 * h),
          realtime::log(Eigen::Quaterniond(b.linear() * a.linear().transpose())) / (2 * h);
      EXPECT_LT((J.col(i) - column).norm(), 1e-8);
    }
    model.update(q + h * dq, dq);
    const Vector6 after = model.jacobian() * dq;
    model.update(q - h * dq, dq);
    const Vector6 before = model.jacobian() * dq;
    EXPECT_LT((dJ_dq - (after - before) / (2 * h)).norm(), 1e-6);
  }
}

TEST_P(ModelOf, mass_matrix_is_that_of_the_kinetic_energy) {
  for (int n = 0; n < 10; ++n) {
    anywhere();
    const Matrix7 M = model.mass();
    EXPECT_EQ(M, M.transpose());
    const double energy = kinetic_energy(arm, tool, q, dq);
    EXPECT_NEAR(0.5 * dq.dot(M * dq), energy, 1e-6 * energy);
    const Vector7 other = Vector7::Random();
    EXPECT_NEAR(0.5 * other.dot(M * other), kinetic_energy(arm, tool, q, other), 1e-6 * energy);
  }
}

// Lagrange: C dq = dM/dt dq - 1/2 d(dq' M dq)/dq.
TEST_P(ModelOf, coriolis_torque_is_that_of_the_mass_matrix) {
  constexpr double h = 1e-5;
  for (int n = 0; n < 10; ++n) {
    anywhere();
    const Vector7 c = model.coriolis();
    Vector7 expected = (mass_at(q + h * dq) - mass_at(q - h * dq)) * dq / (2 * h);
    for (int i = 0; i < 7; ++i) {
      const Vector7 by = h * Vector7::Unit(i);
      expected[i] -= 0.5 * dq.dot((mass_at(q + by) - mass_at(q - by)) * dq) / (2 * h);
    }
    EXPECT_LT((c - expected).norm(), 1e-6);
  }
}

// With these rates the tool moves as wanted and the elbow rests.
TEST_P(ModelOf, joints_go_along_with_a_pose) {
  for (int n = 0; n < 10; ++n) {
    anywhere();
    const realtime::JointsOfPose joints = model.joints_of_pose(q);
    EXPECT_EQ(joints.q, q);
    const Vector6 twist = Vector6::Random();
    const Vector7 rates = joints.dq_dP * twist;
    if (rates.norm() > 20) continue;  // next to a singularity they are damped
    EXPECT_LT((model.jacobian() * rates - twist).norm(), 1e-3);
    EXPECT_EQ(rates[2], 0);
  }
}

TEST_P(ModelOf, names_may_have_a_prefix_and_a_hand_may_hang_on_the_flange) {
  anywhere();
  std::string text = models::urdf(arm, 10);
  text = replaced(replaced(text, "\"joint", "\"arm_joint"), "\"link", "\"arm_link");
  const std::string hand = R"(
    <link name="arm_hand"><inertial><origin xyz="0 0 0.05" rpy="0 0 0"/><mass value="0.73"/>
      <inertia ixx="0.001" iyy="0.002" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="arm_hand_joint" type="fixed"><parent link="arm_link8"/><child link="arm_hand"/></joint>
    <link name="arm_leftfinger"><inertial><mass value="0.1"/><origin xyz="0 0 0" rpy="0 0 0"/>
      <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="arm_finger_joint1" type="prismatic"><parent link="arm_hand"/><child link="arm_leftfinger"/>
      <axis xyz="0 1 0"/><limit lower="0" upper="0.04" velocity="0.2" effort="20"/></joint>
    <link name="base"/>
    <joint name="base_joint" type="fixed"><parent link="base"/><child link="arm_link0"/>
      <origin xyz="0 0 0.5" rpy="0 0 0"/></joint>
  </robot>)";
  text = replaced(text, "</robot>", hand);
  Model other(text);
  other.set_tool(tool.mass, tool.com, tool.inertia, tool.F_T_EE);
  other.update(q, dq);
  EXPECT_TRUE(other.O_T_EE().isApprox(model.O_T_EE(), 1e-12));
  EXPECT_TRUE(other.jacobian().isApprox(model.jacobian(), 1e-12));
  EXPECT_TRUE(other.mass().isApprox(model.mass(), 1e-12));
  EXPECT_TRUE(other.coriolis().isApprox(model.coriolis(), 1e-10));
}

TEST_P(ModelOf, what_a_urdf_lacks_is_named) {
  const std::string text = models::urdf(arm, 10);
  const auto message = [](const std::string& urdf) -> std::string {
    try {
      Model model(urdf);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_NE(message(replaced(text, "\"joint5\"", "\"elbow\"")).find("joint5 is missing"), std::string::npos);
  EXPECT_NE(message(replaced(text, "\"link8\"", "\"tip\"")).find("link8"), std::string::npos);
  EXPECT_NE(message("<robot").find("URDF"), std::string::npos);
  EXPECT_NE(message("").find("URDF"), std::string::npos);
}

TEST_P(ModelOf, update_allocates_nothing) {
  if (!allocations::kCounts) GTEST_SKIP() << "the heap belongs to a sanitizer";
  testing_tools::AllocationCounter allocations;
  for (int n = 0; n < 100; ++n) {
    anywhere();
    model.set_tool(tool.mass, tool.com, tool.inertia, tool.F_T_EE);
    model.O_T_EE(q);
    model.joints_of_pose(q);
  }
  EXPECT_EQ(allocations.count(), 0);
}

}  // namespace
