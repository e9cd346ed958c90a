#pragma once

#include "sim/robot/motion_generator.hpp"

namespace sim {

// The robot's own control laws. Both return tau_d (N m), without gravity (compensated by the caller) but with Coriolis and
// what tracking needs: pushed at rest, the arm yields by 1/K. Franka does not publish its damping; here every mode has the
// damping ratio 0.7 (double diagonalisation with the mass matrix, Albu-Schäffer, Ott, Frese, Hirzinger, Cartesian
// impedance control of redundant robots, ICRA 2003).
class InternalController {
 public:
  using Vector7 = Eigen::Matrix<double, 7, 1>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;

  // Franka's defaults (setDefaultBehavior of its examples).
  Vector7 K_theta = (Vector7() << 3000, 3000, 3000, 2500, 2500, 2000, 2000).finished();
  Vector6 K_x = (Vector6() << 3000, 3000, 3000, 300, 300, 300).finished();
  Eigen::Matrix4d EE_T_K = Eigen::Matrix4d::Identity();

  // Joint impedance about (q_d, dq_d) with inertia feed-forward of ddq_d.
  Vector7 joint_impedance(const ArmModel& model, const Vector7& q, const Vector7& dq,
                          const MotionGenerator::Desired& desired);
  // Cartesian impedance about the pose of (q_d, dq_d), stiff at the origin and along the axes of the frame K; the
  // redundancy is held by a spring of 50 N m/rad in each joint that does not move K.
  Vector7 cartesian_impedance(const ArmModel& model, const Eigen::Matrix4d& F_T_EE, const Vector7& q,
                              const Vector7& dq, const MotionGenerator::Desired& desired);

 private:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Matrix7 = Eigen::Matrix<double, 7, 7>;

  // The damping follows the posture, which changes slowly: computed anew every so many cycles.
  static constexpr unsigned kRefresh = 20;
  static constexpr double kNullspaceStiffness = 50;  // N m/rad
  unsigned joint_damping_age_ = 0, cartesian_damping_age_ = 0;
  Matrix7 joint_damping_ = Matrix7::Zero(), nullspace_damping_ = Matrix7::Zero();
  Matrix6 cartesian_damping_ = Matrix6::Zero();
};

}  // namespace sim
