#pragma once

#include <Eigen/Geometry>

#include "models/arm.hpp"
#include "sim/robot/rigid_body.hpp"

namespace sim {

// The hand as it is configured in a robot that carries it.

// Its tool centre in the flange frame: the nominal end effector.
inline Eigen::Matrix4d F_T_hand_TCP() {
  Eigen::Isometry3d T(Eigen::AngleAxisd(models::hand::kYaw, Eigen::Vector3d::UnitZ()));
  T.translation().z() = models::hand::kTcp;
  return T.matrix();
}

// Hand and both fingers, closed, in the flange frame.
inline RigidBody franka_hand() {
  const auto body = [](const models::Link& link, double yaw, double z) {
    const Eigen::Matrix3d R = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    const auto& I = link.inertia;
    Eigen::Matrix3d inertia;
    inertia << I[0], I[3], I[4], I[3], I[1], I[5], I[4], I[5], I[2];
    return RigidBody{link.mass, R * Eigen::Vector3d(link.com.data()) + Eigen::Vector3d(0, 0, z),
                     R * inertia * R.transpose()};
  };
  using namespace models::hand;
  return joined(body(kHand, kYaw, 0),
                joined(body(kFinger, kYaw, kFingerZ), body(kFinger, kYaw + M_PI, kFingerZ)));
}

}  // namespace sim
