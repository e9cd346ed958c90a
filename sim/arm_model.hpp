#pragma once

#include <Eigen/Core>
#include <memory>

#include "models/arm.hpp"

namespace sim {

// The arm as its own controller knows it: nominal figures of the links, and the end effector and
// load that were configured. Used for gravity compensation, the internal control laws and the
// estimates in the state; the physics is World's.
class ArmModel {
 public:
  using Vector7 = Eigen::Matrix<double, 7, 1>;
  using Matrix67 = Eigen::Matrix<double, 6, 7>;  // rows: linear, then angular, axes of O
  using Matrix77 = Eigen::Matrix<double, 7, 7>;

  explicit ArmModel(const models::Arm& arm);
  ~ArmModel();

  // Mass (kg), centre of mass in the flange frame (m), inertia about it in the flange's axes (kg m²):
  // end effector and load together.
  void set_tool(double mass, const Eigen::Vector3d& F_x_C, const Eigen::Matrix3d& I);

  // Computes what follows for q and dq.
  void update(const Vector7& q, const Vector7& dq);
  const Eigen::Matrix4d& O_T_F() const;  // flange
  Matrix67 jacobian(const Eigen::Vector3d& F_p) const;  // of the point F_p in the flange frame
  const Matrix77& mass() const;
  const Vector7& coriolis() const;  // C(q, dq) dq
  const Vector7& gravity() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace sim
