#pragma once

#include <array>
#include <vector>

#include "sim/arm_model.hpp"

namespace sim {

// How near the arm is to itself, with the hand on its flange: the least distance between the vendor's capsules
// (models::capsules()) of links that are not neighbours. Links nearer than three joints to each other cannot meet
// within their ranges, or always overlap, and are left out; the hand counts as a link.
class SelfCollision {
 public:
  explicit SelfCollision(const models::Arm& arm);

  // m; between surfaces, negative where they overlap. `at`: kinematics of the posture. Exact up to `horizon`, beyond it
  // some distance that is greater.
  double distance(const ArmModel& at, double horizon) const;

 private:
  struct Capsule {
    int link;                      // 0 to 7
    Eigen::Vector3d centre, half;  // of the axis, and from there to its end; in the link's frame, m
    double radius, reach;          // m; reach: of the sphere around centre that holds it
  };
  std::vector<Capsule> capsules_;
  std::vector<std::pair<int, int>> pairs_;
};

}  // namespace sim
