#pragma once

#include <string>

#include "realtime/model.hpp"

namespace realtime {

struct SpringFields {
  std::string stiffness = "stiffness", damping = "damping";
};

// Throws std::invalid_argument naming field, value and bound unless a loop of 1 ms can hold each joint with that spring (K)
// and damper (D). Its torque acts a cycle after what it answers to: with inertia m and T = 1 ms, a = K T²/m, b = D T/m,
//   v+ = v - (a q/T + b v) of the cycle before,  q+ = q + T v+,  with the characteristic z³ - 2 z² + (1 + a + b) z - b,
// stable (Jury) if and only if b < 1 and a < b (1 - b). So no damping lets K exceed m / (4 T²). m is the least inertia that
// the joint can show in this posture: with all others free. `fields`: what K and D are called where they came from.
void require_holdable(const Vector7& stiffness, const Vector7& damping, const Matrix7& inertia, const SpringFields& fields = {});

}  // namespace realtime
