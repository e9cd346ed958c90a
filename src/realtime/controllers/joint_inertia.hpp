#pragma once

#include "realtime/model.hpp"

namespace realtime {

// What the motors add to the inertia of each joint, kg m². Reflected, FR3's are 0.606, 0.606, 0.462, 0.462, 0.206, 0.206,
// 0.206 (Franka's figures, published with Drake's description of the arm); the robot's joint torque feedback makes them
// appear smaller (Albu-Schäffer, Ott, Hirzinger, A unified passivity-based control framework for position, torque and
// impedance control of flexible joint robots, Int. J. Robotics Research 26(1), 2007), here by six, which is assumed.
inline const Vector7 kMotorInertia = (Vector7() << 0.101, 0.101, 0.077, 0.077, 0.034, 0.034, 0.034).finished();

// Links and motors.
inline Matrix7 felt_inertia(const Matrix7& links) noexcept {
  Matrix7 M = links;
  M.diagonal() += kMotorInertia;
  return M;
}

// Throws std::invalid_argument naming field, value and bound unless a loop of 1 ms can hold each joint with that spring (K)
// and damper (D). Its torque acts a cycle after what it answers to: with inertia m and T = 1 ms, a = K T²/m, b = D T/m,
//   v+ = v - (a q/T + b v) of the cycle before,  q+ = q + T v+,  with the characteristic z³ - 2 z² + (1 + a + b) z - b,
// stable (Jury) if and only if b < 1 and a < b (1 - b). So no damping lets K exceed m / (4 T²). m is the least inertia that
// the joint can show in this posture: with all others free.
void require_holdable(const Vector7& stiffness, const Vector7& damping, const Matrix7& inertia);

}  // namespace realtime
