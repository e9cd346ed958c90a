#pragma once

#include <utility>
#include <vector>

#include "sim/robot/arm_capsules.hpp"

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
  ArmCapsules capsules_;
  std::vector<std::pair<int, int>> pairs_;
};

}  // namespace sim
