#include "sim/robot/internal_controller.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "models/joint_figures.hpp"
#include "sim/robot/rotation.hpp"

namespace sim {
namespace {

constexpr double kDampingRatio = 0.7;

// Of joints and of Cartesian directions, with one solver for both, as it takes long to compile.
using UpTo7 = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 7, 7>;

// Damping for which each mode of (mass, stiffness) has kDampingRatio (double diagonalisation,
// Albu-Schäffer et al., "Cartesian impedance control of redundant robots", 2003).
UpTo7 damping(const UpTo7& mass, const UpTo7& stiffness) {
  // stiffness V = mass V diag(w²), V' mass V = 1, so D = mass V diag(2 ζ w) V' mass.
  const Eigen::GeneralizedSelfAdjointEigenSolver<UpTo7> modes(stiffness, mass);
  const UpTo7 MV = mass * modes.eigenvectors();
  return MV * (2 * kDampingRatio * modes.eigenvalues().cwiseMax(0).cwiseSqrt()).asDiagonal() * MV.transpose();
}

}  // namespace

InternalController::Vector7 InternalController::joint_impedance(
    const ArmModel& model, const Vector7& q, const Vector7& dq,
    const MotionGenerator::Desired& desired) {
  Matrix7 mass = model.mass();
  mass.diagonal() += Eigen::Map<const Vector7>(models::kMotorInertia.data());
  if (joint_damping_age_++ % kRefresh == 0) {
    joint_damping_ = damping(mass, Matrix7(K_theta.asDiagonal()));
  }
  return K_theta.cwiseProduct(desired.q - q) + joint_damping_ * (desired.dq - dq) +
         mass * desired.ddq + model.coriolis();
}

InternalController::Vector7 InternalController::cartesian_impedance(
    const ArmModel& model, const Eigen::Matrix4d& F_T_EE, const Vector7& q, const Vector7& dq,
    const MotionGenerator::Desired& desired) {
  const Eigen::Matrix4d F_T_K = F_T_EE * EE_T_K;
  const Eigen::Matrix4d O_T_K = model.O_T_F() * F_T_K;
  const Eigen::Matrix4d O_T_K_d = desired.O_T_EE_d * EE_T_K;
  const ArmModel::Matrix67 J = model.jacobian(F_T_K.topRightCorner<3, 1>());

  Vector6 error;
  error.head<3>() = O_T_K_d.topRightCorner<3, 1>() - O_T_K.topRightCorner<3, 1>();
  error.tail<3>() = rotation_between(O_T_K.topLeftCorner<3, 3>(), O_T_K_d.topLeftCorner<3, 3>());
  // Stiffness along the axes of K, everything else in those of O.
  const Eigen::Matrix3d R = O_T_K_d.topLeftCorner<3, 3>();
  Matrix6 K = Matrix6::Zero();
  K.topLeftCorner<3, 3>() = R * K_x.head<3>().asDiagonal() * R.transpose();
  K.bottomRightCorner<3, 3>() = R * K_x.tail<3>().asDiagonal() * R.transpose();

  Matrix7 mass = model.mass();
  mass.diagonal() += Eigen::Map<const Vector7>(models::kMotorInertia.data());
  const Eigen::Matrix<double, 7, 6> M_inv_Jt = mass.llt().solve(J.transpose());
  Matrix6 mobility = J * M_inv_Jt;
  mobility.diagonal().array() += 1e-6;  // bounded next to singularities
  const Matrix6 inertia = mobility.llt().solve(Matrix6::Identity());
  if (cartesian_damping_age_++ % kRefresh == 0) {
    cartesian_damping_ = damping(inertia, K);
    nullspace_damping_ = damping(mass, kNullspaceStiffness * Matrix7::Identity());
  }

  const Vector6 velocity_error = J * (desired.dq - dq);
  const Vector6 force = K * error + cartesian_damping_ * velocity_error;
  const Vector7 posture =
      kNullspaceStiffness * (desired.q - q) + nullspace_damping_ * (desired.dq - dq);
  // Dynamically consistent: the posture's torque does not move K (Khatib 1987).
  const Vector7 nullspace = posture - J.transpose() * (inertia * (M_inv_Jt.transpose() * posture));
  return J.transpose() * force + nullspace + mass * desired.ddq + model.coriolis();
}

}  // namespace sim
