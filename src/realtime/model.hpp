#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <string>

#include "realtime/reference.hpp"

namespace realtime {

using Matrix7 = Eigen::Matrix<double, 7, 7>;

// Kinematics and dynamics of the arm with its end effector and load (Pinocchio behind it). Built in
// the server room; everything but the constructor is free of allocation and may run in the loop.
class Model {
 public:
  // From an URDF with joints joint1..joint7 (any prefix) and the flange, link8. Throws
  // std::invalid_argument which says what is missing.
  explicit Model(const std::string& urdf);
  ~Model();
  Model(const Model&) = delete;

  // What is fixed to the flange: total mass (kg), centre of mass in F (m), inertia about it in F's
  // axes (kg m²); and the end-effector frame.
  void set_tool(double mass, const Vector3& F_x_C, const Eigen::Matrix3d& I,
                const Eigen::Isometry3d& F_T_EE) noexcept;

  // Computes everything below for q and dq.
  void update(const Vector7& q, const Vector7& dq) noexcept;

  const Eigen::Isometry3d& O_T_EE() const noexcept;
  // Of EE, rows linear then angular, axes of O.
  const Matrix67& jacobian() const noexcept;
  const Vector6& dJ_dq() const noexcept;      // d/dt(J) dq, m/s² and rad/s²
  const Matrix7& mass() const noexcept;
  const Vector7& coriolis() const noexcept;   // C(q, dq) dq, N m

  // What holds the arm and its tool against an acceleration `O_g` (m/s², (0, 0, -9.81) upright) at q of update(); N m.
  Vector7 gravity(const Vector3& O_g) const noexcept;

  // Forward kinematics of any q, without touching the rest.
  Eigen::Isometry3d O_T_EE(const Vector7& q) noexcept;

  // How the joints go along with a motion of EE, from any q. `damping`, m² and rad² (0.01 is the square of a singular value at home):
  // next to singularities they leave EE behind, and stay calm. Without it they do not, as those of a robot; it then is as good as
  // none, so that the map stays finite.
  static constexpr double kCalm = 1e-6, kNoDamping = 1e-10;
  JointsOfPose joints_of_pose(const Vector7& q, double damping = kCalm) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace realtime
