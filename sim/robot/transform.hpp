#pragma once

#include <Eigen/Geometry>
#include <cmath>

#include "wire/fci/robot_state.hpp"

namespace sim {

inline Eigen::Matrix4d matrix(const fci::Pose& pose) { return Eigen::Map<const Eigen::Matrix4d>(pose.data()); }

inline fci::Pose pose(const Eigen::Matrix4d& matrix) {
  fci::Pose pose;
  Eigen::Map<Eigen::Matrix4d>(pose.data()) = matrix;
  return pose;
}

// A rotation and a translation, to the precision that libfranka asks of its callers.
inline bool is_transform(const fci::Pose& pose) {
  constexpr double kTolerance = 1e-5;
  const Eigen::Matrix4d T = matrix(pose);
  if (!T.allFinite()) return false;
  const Eigen::Matrix3d R = T.topLeftCorner<3, 3>();
  return (T.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() <= kTolerance &&
         (R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <= kTolerance &&
         R.col(0).cross(R.col(1)).dot(R.col(2)) > 0;
}

}  // namespace sim
