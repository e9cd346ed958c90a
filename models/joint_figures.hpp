#pragma once

#include "models/arm.hpp"

namespace models {

// What Franka does not publish about the joints of its arms, decided here once for those who simulate and those who control
// them; joint1 to joint7.

// Inertia of rotor and gear as felt at the joint, kg m². Reflected, FR3's are 0.606, 0.606, 0.462, 0.462, 0.206, 0.206,
// 0.206 (Franka's figures, published with Drake's description of the arm). The robot's joint torque feedback makes them
// appear smaller (Albu-Schäffer, Ott, Hirzinger, A unified passivity-based control framework for position, torque and
// impedance control of flexible joint robots, Int. J. Robotics Research 26(1), 2007); here by six, which is assumed.
inline constexpr Vector7 kMotorInertia = {0.101, 0.101, 0.077, 0.077, 0.034, 0.034, 0.034};

// Friction which the arm leaves after its own compensation. Sliding, it is what Gaz, Cognetti, Oliva, Robuffo Giordano,
// De Luca (Dynamic identification of the Franka Emika Panda robot with retrieval of feasible parameters using
// penalty-based optimization, IEEE RA-L 4(4), 2019) found through a Panda's torque sensors, that is behind its
// compensation: phi_1 / (1 + exp(-phi_2 dq)) - phi_1 / 2, without their small offsets. That vanishes at rest, where
// nobody has published what is left; taken is that 15 % of phi_1 stick, some half of the 0.2 N m which
// franka_description has for all joints. It leaves an arm of 600 N/m and 50 N m/rad 2 or 3 mm from its goal.
inline constexpr Vector7 kFrictionHeight = {0.546, 0.872, 0.641, 1.279, 0.839, 0.303, 0.565};  // phi_1, N m
inline constexpr Vector7 kFrictionRise = {5.12, 9.07, 10.14, 5.59, 8.35, 17.13, 10.34};        // phi_2, s/rad
inline constexpr double kStickingShare = 0.15;                                                // of phi_1

// What all joints together may take, torque times velocity of those that drive, before the robot reports power_limit_violation; W.
// Franka's staff say that a joint takes the more the more torque it needs, and that not all can go full speed at once (libfranka
// #143); the figure is assumed.
inline constexpr double kMostPower = 200;

}  // namespace models
