#pragma once

#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "models/arm.hpp"
#include "realtime/reference.hpp"

namespace realtime {

// The body of an arm as capsules: the vendor's (models::capsules()), and what is fixed to its flange.
class ArmCapsules {
 public:
  static constexpr int kMostHeld = 12, kMost = 12 + kMostHeld;
  static constexpr int kFlange = 8;  // the number of the flange as a link; the hand is on it

  struct Capsule {
    int link;      // 2 to 7, or kFlange
    Vector3 a, b;  // the ends of its axis in the link's frame, m
    double radius;
  };

  // Where they are in O. The base does not move, nor does link 1, which turns about the axis of its capsule: both are left out.
  struct Place {
    std::array<Vector3, kMost> a, b;                     // m
    std::array<Vector3, models::kJoints> origin, axis;  // of the joints
  };

  // `hand`: a Franka hand is on the flange.
  ArmCapsules(const models::Arm& arm, bool hand);

  // Fixed to the flange F; false when there are too many.
  bool hold(const Vector3& F_a, const Vector3& F_b, double radius);

  const std::vector<Capsule>& all() const noexcept { return capsules_; }

  void place(const Vector7& q, Place& out) const noexcept;

  // d(normal . point)/dq for a point of capsule `index` that is placed there.
  Vector7 gradient(const Place& place, int index, const Vector3& O_point, const Vector3& normal) const noexcept;

 private:
  std::array<Eigen::Isometry3d, models::kJoints + 1> frames_;  // of a joint in the one before, at zero; the flange is last
  std::vector<Capsule> capsules_;
};

}  // namespace realtime
