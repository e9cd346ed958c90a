// The figures of the arms against what real arms say.

#include "models/arm.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace {

using models::Vector3;
using models::Vector7;
using Matrix3 = std::array<Vector3, 3>;  // rows

constexpr double kGravity = 9.81;  // m/s²
// The hand as Desk gives it to the robot, in the flange's frame.
constexpr double kHandMass = 0.73;  // kg
constexpr Vector3 kHandCom = {-0.01, 0, 0.03};

Matrix3 product(const Matrix3& a, const Matrix3& b) {
  Matrix3 c{};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) c[i][j] += a[i][k] * b[k][j];
    }
  }
  return c;
}
Vector3 moved(const Matrix3& R, const Vector3& p, const Vector3& x) {
  Vector3 y = p;
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) y[i] += R[i][k] * x[k];
  }
  return y;
}
Matrix3 about_x(double angle) {
  return {{{1, 0, 0}, {0, std::cos(angle), -std::sin(angle)}, {0, std::sin(angle), std::cos(angle)}}};
}
Matrix3 about_z(double angle) {
  return {{{std::cos(angle), -std::sin(angle), 0}, {std::sin(angle), std::cos(angle), 0}, {0, 0, 1}}};
}

// Of the links and the hand, J; straight from the figures.
double potential_energy(const models::Arm& arm, const Vector7& q) {
  Matrix3 R = about_x(0);
  Vector3 p{};
  double energy = 0;
  for (int i = 0; i < 8; ++i) {
    const auto& [xyz, rpy] = arm.joints[i];
    EXPECT_EQ(rpy[1], 0);
    EXPECT_EQ(rpy[2], 0);
    p = moved(R, p, xyz);
    R = product(R, about_x(rpy[0]));
    if (i == 7) break;
    R = product(R, about_z(q[i]));
    energy += arm.links[i + 1].mass * kGravity * moved(R, p, arm.links[i + 1].com)[2];
  }
  return energy + kHandMass * kGravity * moved(R, p, kHandCom)[2];
}

double gravity(const models::Arm& arm, int joint) {
  constexpr double kStep = 1e-5;
  Vector7 up = models::kHome, down = models::kHome;
  up[joint] += kStep;
  down[joint] -= kStep;
  return (potential_energy(arm, up) - potential_energy(arm, down)) / (2 * kStep);
}

// tau_J of a real FER at home is that of Franka's sample output, friction included; a model that others fitted to a
// real FER's own library gives -4.53 and 21.84 N m at joints 2 and 4.
TEST(Figures, FersGravityIsThatOfARealOne) {
  const models::Arm& fer = models::arm("fer");
  const Vector7 measured = {-0.00, -5.09, 0.11, 21.81, 0.63, 2.18, -0.05};
  constexpr double kFriction = 1.3;  // N m
  for (int i = 0; i < models::kJoints; ++i) EXPECT_NEAR(gravity(fer, i), measured[i], kFriction) << "joint " << i + 1;
  EXPECT_NEAR(gravity(fer, 1), -3.92, 0.01);
  EXPECT_NEAR(gravity(fer, 3), 21.90, 0.01);
  EXPECT_NEAR(gravity(fer, 5), 2.27, 0.01);
}

TEST(Figures, InertiasArePositive) {
  for (const models::Arm& arm : models::arms()) {
    for (const models::Link& link : arm.links) {
      const auto [xx, yy, zz, xy, xz, yz] = link.inertia;
      EXPECT_GT(link.mass, 0);
      EXPECT_GT(xx, 0);
      EXPECT_GT(xx * yy - xy * xy, 0);
      EXPECT_GT(xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz), 0) << arm.name;
    }
  }
}

}  // namespace
