#pragma once

namespace sim {

// What Franka does not publish about its joints, decided here once.

// Of rotor and gear, felt at the link: kg m². The value that MuJoCo's models of this arm use.
inline constexpr double kRotorInertia = 0.1;

// What is left of the joint's friction after the robot's own compensation. The figures of
// franka_description: a placeholder there, of the size that leaves a compliant arm (600 N/m) a
// millimetre or so from its goal, as one sees on the real one.
inline constexpr double kCoulombFriction = 0.2;    // N m
inline constexpr double kViscousFriction = 0.003;  // N m s/rad

// Between motor and link: theta - q = tau_J / stiffness. Harmonic drives of this size; N m/rad.
inline constexpr double kJointStiffness = 14250;  // libfranka takes K_theta up to this

}  // namespace sim
