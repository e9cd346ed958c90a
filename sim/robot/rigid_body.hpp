#pragma once

#include <Eigen/Core>

namespace sim {

struct RigidBody {
  double mass = 0;                                       // kg
  Eigen::Vector3d com = Eigen::Vector3d::Zero();         // m
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();     // about com; kg m²

  bool operator==(const RigidBody&) const = default;
};

// Two bodies that are fixed to one another, both in the same frame.
inline RigidBody joined(const RigidBody& a, const RigidBody& b) {
  RigidBody sum;
  sum.mass = a.mass + b.mass;
  if (sum.mass == 0) return sum;
  sum.com = (a.mass * a.com + b.mass * b.com) / sum.mass;
  for (const RigidBody* part : {&a, &b}) {
    const Eigen::Vector3d r = part->com - sum.com;
    sum.inertia += part->inertia +
                   part->mass * (r.squaredNorm() * Eigen::Matrix3d::Identity() - r * r.transpose());
  }
  return sum;
}

}  // namespace sim
