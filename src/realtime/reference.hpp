#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace realtime {

using Vector3 = Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Vector7 = Eigen::Matrix<double, 7, 1>;

enum class ReferenceKind { kJoint, kCartesian };

struct JointReference {
  Vector7 q = Vector7::Zero();    // rad
  Vector7 dq = Vector7::Zero();   // rad/s
  Vector7 ddq = Vector7::Zero();  // rad/s²
};

// Of the end-effector frame EE in the base frame O; linear before angular.
struct CartesianReference {
  Vector3 position = Vector3::Zero();                                    // m
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  Vector6 velocity = Vector6::Zero();                                    // m/s, rad/s
  Vector6 acceleration = Vector6::Zero();                                // m/s², rad/s²
};

// What a trajectory generator emits each cycle. Only the member named by `kind` means something.
struct Reference {
  ReferenceKind kind = ReferenceKind::kJoint;
  JointReference joint;
  CartesianReference cartesian;
};

}  // namespace realtime
