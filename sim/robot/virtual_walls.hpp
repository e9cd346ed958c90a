#pragma once

#include <Eigen/Geometry>
#include <map>

#include "sim/robot/arm_capsules.hpp"

namespace sim {

// A cuboid that the arm must not enter: from the origin of its frame, in O, along the axes (libfranka's VirtualWallCuboid).
struct VirtualWall {
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  // m
  Eigen::Isometry3d frame = Eigen::Isometry3d::Identity();
  bool active = false;
};

// Those that somebody has set up at the robot.
class VirtualWalls {
 public:
  explicit VirtualWalls(const models::Arm& arm) : capsules_(arm) {}

  void set(int id, const VirtualWall& wall) { walls_[id] = wall; }
  // One that was never set up is not active.
  VirtualWall get(int id) const;

  // From the capsules of the links that move to the nearest active wall, m: negative inside, infinite where there is none.
  // `at`: kinematics of the posture. Capsules are looked at as balls every kBalls along their axes.
  double distance(const ArmModel& at) const;

 private:
  static constexpr double kBalls = 0.02;  // m

  ArmCapsules capsules_;
  std::map<int, VirtualWall> walls_;
};

}  // namespace sim
