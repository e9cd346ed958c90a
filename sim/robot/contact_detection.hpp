#pragma once

#include <Eigen/Core>

#include "wire/fci/service.hpp"

namespace sim {

// Contact above the lower thresholds, while it lasts; collision above the upper ones, until it is reset. The wrench is
// looked at in the axes of K (not published: libfranka says "x, y, z, R, P, Y" and no frame).
class ContactDetection {
 public:
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Vector7 = Eigen::Matrix<double, 7, 1>;

  // One cycle; accelerating chooses the set of thresholds.
  void update(const fci::SetCollisionBehavior& thresholds, bool accelerating, const Vector7& tau, const Vector6& K_F);
  void reset();

  fci::Vector7 joint_contact{}, joint_collision{};          // 0 or 1
  fci::Vector6 cartesian_contact{}, cartesian_collision{};
  bool joint = false, cartesian = false;  // a collision in this cycle
};

}  // namespace sim
