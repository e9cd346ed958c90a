#pragma once

#include <string>

#include "realtime/model.hpp"

namespace realtime {

// What is left to a joint where all others are held as hard, kg m²: with W the mobility, joint_mobility(),
//   1/m_i = W_ii sum_j |W_ij| / sqrt(W_ii W_jj),
// so that no eigenvalue of M^-1 D T exceeds the largest D_i T/m_i (Gershgorin).
Vector7 inertia_to_hold(const Matrix7& mobility) noexcept;

struct SpringFields {
  std::string stiffness = "stiffness", damping = "damping";
};

// Throws std::invalid_argument naming field, value and bound unless a loop of 1 ms can hold each joint with that spring (K)
// and damper (D). Its torque acts a cycle after what it answers to: with inertia m and T = 1 ms, a = K T²/m, b = D T/m,
//   v+ = v - (a q/T + b v) of the cycle before,  q+ = q + T v+,  with the characteristic z³ - 2 z² + (1 + a + b) z - b,
// stable (Jury) if and only if b < 1 and a < b (1 - b). So no damping lets K exceed m / (4 T²). m is inertia_to_hold() in this
// posture. `fields`: what K and D are called where they came from.
void require_holdable(const Vector7& stiffness, const Vector7& damping, const Matrix7& inertia, const SpringFields& fields = {});

// Makes a spring or damper softer that is harder than what such a loop can hold where the arm is now; `mobility`: joint_mobility().
void keep_holdable(const Matrix7& mobility, Vector7& stiffness, Vector7& damping) noexcept;

}  // namespace realtime
