#pragma once

#include <array>
#include <optional>
#include <span>

#include "realtime/walls/arm_capsules.hpp"

namespace realtime {

// How near an arm is to itself: the least distance between capsules of links that are not neighbours (nearer than three joints
// to each other they cannot meet, or always overlap). What it holds counts with the flange; the robot does not know of that.
struct SelfDistance {
  double distance = 1e9;          // m, between surfaces; negative where they overlap
  std::array<int, 2> links = {};  // that are so near, ArmCapsules::Capsule::link
};
SelfDistance self_distance(const ArmCapsules& arm, const Vector7& q) noexcept;

// Two links that are nearer than `clearance` (m) at q, and by more than `rounding` (m) nearer than they are at `from`; the nearest
// of such. Others may lie nearer to each other than these, and stay so.
std::optional<SelfDistance> comes_nearer(const ArmCapsules& arm, const Vector7& from, const Vector7& q, double clearance,
                                         double rounding) noexcept;

// Two such links, and how what is between them changes with the joints, m/rad.
struct SelfContact {
  double distance;
  Vector7 gradient;
};
// Those that are nearer than `horizon` (m) where the arm is placed, the nearest if there is not room for all; returns how many. Of
// two that are almost parallel also what is between their ends, as the nearest place leaps from one end to the other when they tilt.
std::size_t self_contacts(const ArmCapsules& arm, const ArmCapsules::Place& place, double horizon,
                          std::span<SelfContact> out) noexcept;

// The least distance that motions keep: the robot stops an arm that comes nearer to itself than the vendor's margin.
inline constexpr double kSelfClearance = models::kCapsuleMargin + 0.001;  // m

}  // namespace realtime
