#pragma once

#include <Eigen/Geometry>

#include "models/arm.hpp"

namespace sim {

// Rotation vector (axis times angle, rad, angle at most pi) that turns `from` into `to`, in base axes.
inline Eigen::Vector3d rotation_between(const Eigen::Matrix3d& from, const Eigen::Matrix3d& to) {
  Eigen::Quaterniond quaternion(Eigen::Matrix3d(to * from.transpose()));
  if (quaternion.w() < 0) quaternion.coeffs() = -quaternion.coeffs();
  const double sine = quaternion.vec().norm();
  if (sine < 1e-12) return 2 * quaternion.vec();
  return quaternion.vec() * (2 * std::atan2(sine, quaternion.w()) / sine);
}

inline Eigen::Matrix3d rotation_of(const Eigen::Vector3d& vector) {
  const double angle = vector.norm();
  if (angle < 1e-15) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix();
}

// About fixed axes x, y, z one after the other, rad; as models::JointFrame has it.
inline Eigen::Matrix3d rotation_of_rpy(const models::Vector3& rpy) {
  using Eigen::AngleAxisd, Eigen::Vector3d;
  return (AngleAxisd(rpy[2], Vector3d::UnitZ()) * AngleAxisd(rpy[1], Vector3d::UnitY()) * AngleAxisd(rpy[0], Vector3d::UnitX()))
      .toRotationMatrix();
}

}  // namespace sim
