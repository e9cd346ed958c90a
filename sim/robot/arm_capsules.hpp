#pragma once

#include <array>
#include <vector>

#include "sim/robot/arm_model.hpp"

namespace sim {

// The vendor's capsules (models::capsules()) around the links, with the hand on its flange.
class ArmCapsules {
 public:
  static constexpr int kMost = 16;

  struct Capsule {
    int link;                      // 0 to 8; 8 is the hand
    Eigen::Vector3d centre, half;  // of the axis, and from there to its end; in the frame of joint min(link, 7), m
    double radius, reach;          // m; reach: of the sphere around centre that holds it
  };
  // Of each its axis in O, m.
  struct Axes {
    std::array<Eigen::Vector3d, kMost> centre, half;
  };

  explicit ArmCapsules(const models::Arm& arm);

  const std::vector<Capsule>& all() const { return capsules_; }
  // `at`: kinematics of the posture.
  Axes place(const ArmModel& at) const;

 private:
  std::vector<Capsule> capsules_;
};

}  // namespace sim
