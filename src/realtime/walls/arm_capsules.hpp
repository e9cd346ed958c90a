#pragma once

#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "models/arm.hpp"
#include "realtime/reference.hpp"

namespace realtime {

// The body of an arm as capsules: the vendor's (models::capsules()), the hull of the hand, and what is fixed to its flange.
class ArmCapsules {
 public:
  static constexpr int kMostHeld = 12, kMost = 13 + kMostHeld;
  static constexpr int kFlange = 8;  // the number of the flange as a link; the hand is on it, and what is held

  struct Capsule {
    int link;      // 0 to 7, or kFlange
    Vector3 a, b;  // the ends of its axis in the link's frame, m
    double radius;

    bool operator==(const Capsule&) const = default;
  };

  // Where they are in O. The base does not move, nor does link 1, which turns about the axis of its capsule: both are left out,
  // and are fixed().
  struct Place {
    std::array<Vector3, kMost> a, b;                     // m
    std::array<Vector3, models::kJoints> origin, axis;  // of the joints
  };

  // `hand`: a Franka hand is on the flange.
  ArmCapsules(const models::Arm& arm, bool hand);

  // Fixed to the flange F, between two points; false when there are too many.
  bool hold(const Vector3& F_a, const Vector3& F_b, double radius);

  // Those that move: of the robot's self-collision model the first own(), and from held() on what is held. Between them is the hull
  // of the hand.
  const std::vector<Capsule>& all() const noexcept { return capsules_; }
  std::size_t own() const noexcept { return own_; }
  std::size_t held() const noexcept { return held_; }
  // No point of them moves farther by any of the joints, m/rad.
  double reach() const noexcept { return reach_; }
  // Those of the base and of link 1, in O.
  const std::vector<Capsule>& fixed() const noexcept { return fixed_; }

  void place(const Vector7& q, Place& out) const noexcept;

  // d(normal . point)/dq for a point of capsule `index` that is placed there.
  Vector7 gradient(const Place& place, int index, const Vector3& O_point, const Vector3& normal) const noexcept;

 private:
  std::array<Eigen::Isometry3d, models::kJoints + 1> frames_;  // of a joint in the one before, at zero; the flange is last
  std::vector<Capsule> capsules_, fixed_;
  std::size_t own_ = 0, held_ = 0;
  double reach_ = 1.3;  // of an arm that is stretched out, with its hand
};

}  // namespace realtime
