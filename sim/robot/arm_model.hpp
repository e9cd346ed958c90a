#pragma once

#include <Eigen/Core>
#include <array>

#include "models/arm.hpp"

namespace sim {

// The arm as its own controller knows it: nominal figures of the links, and the end effector and load that were
// configured. Used for gravity compensation, the internal control laws and the estimates in the state; the physics is
// World's. Recursive Newton-Euler and composite rigid bodies in spatial coordinates about the origin of O (Featherstone,
// Rigid Body Dynamics Algorithms, 2008, chapters 5 and 6). The base stands upright.
class ArmModel {
 public:
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Vector7 = Eigen::Matrix<double, 7, 1>;
  using Matrix67 = Eigen::Matrix<double, 6, 7>;  // rows: linear, then angular, axes of O
  using Matrix77 = Eigen::Matrix<double, 7, 7>;

  explicit ArmModel(const models::Arm& arm);

  // Mass (kg), centre of mass in the flange frame (m), inertia about it in the flange's axes (kg m²): end effector and
  // load together.
  void set_tool(double mass, const Eigen::Vector3d& F_x_C, const Eigen::Matrix3d& I);

  // Computes all that follows for q (rad) and dq (rad/s).
  void update(const Vector7& q, const Vector7& dq);
  // Computes O_T_F() and jacobian() alone.
  void update_kinematics(const Vector7& q);

  const Eigen::Matrix4d& O_T_F() const { return O_T_F_; }  // flange
  const Eigen::Matrix3d& O_R(int link) const { return R_[link - 1]; }  // axes of link 1 to 7
  const Eigen::Vector3d& O_p(int link) const { return p_[link - 1]; }  // its origin, m
  Matrix67 jacobian(const Eigen::Vector3d& F_p) const;     // of the point F_p (m) in the flange frame
  const Matrix77& mass() const { return mass_; }           // kg m², without the motors' inertia
  const Vector7& coriolis() const { return coriolis_; }    // C(q, dq) dq, N m
  const Vector7& gravity() const { return gravity_; }      // N m: what holds the arm against gravity

 private:
  struct Body {
    double mass;
    Eigen::Vector3d com;      // in the frame of its joint
    Eigen::Matrix3d inertia;  // about com, in the axes of that frame
  };

  std::array<Eigen::Matrix3d, 8> frame_R_;  // of joint i in the frame before it, at q = 0; the eighth is the flange
  std::array<Eigen::Vector3d, 8> frame_p_;
  std::array<Body, 7> links_, bodies_;  // bodies_: the last one with the tool
  std::array<Eigen::Matrix3d, 7> R_;    // axes of joint i in O
  std::array<Eigen::Vector3d, 7> p_;    // origin of joint i in O
  Eigen::Matrix4d O_T_F_;
  Matrix77 mass_ = Matrix77::Zero();
  Vector7 coriolis_ = Vector7::Zero(), gravity_ = Vector7::Zero();
};

}  // namespace sim
