#pragma once

#include <cstdint>

namespace realtime {

// What kept a reference or a torque from being what was asked for: any of these.
enum class HeldBy : std::uint8_t {
  kNothing = 0,
  kMotionLimits = 1,  // of the reference: position, velocity, acceleration, jerk, nearness to a singularity; a stream's speed
  kTorqueLimits = 2,  // torque or its rate
  kJointLimits = 4,   // measured joints near the end of their range, or at their greatest speed
  kWall = 8,
  kArm = 16,          // which stays behind, as something holds it
  kItself = 32,       // the arm, which would have come near to itself
  kToolSpeed = 64,    // Bounds::tool_speed
  kPower = 128,       // Bounds::power, or models::kMostPower
};

constexpr HeldBy operator|(HeldBy a, HeldBy b) { return static_cast<HeldBy>(static_cast<int>(a) | static_cast<int>(b)); }
constexpr HeldBy& operator|=(HeldBy& a, HeldBy b) { return a = a | b; }
constexpr bool has(HeldBy all, HeldBy one) { return (static_cast<int>(all) & static_cast<int>(one)) != 0; }
// That one where it is so.
constexpr HeldBy when(bool so, HeldBy one) { return so ? one : HeldBy::kNothing; }

}  // namespace realtime
