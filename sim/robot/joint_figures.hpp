#pragma once

namespace sim {

// What Franka does not publish about its joints and only a simulated one shows, decided here once; what it shares with those who
// control an arm is in models/joint_figures.hpp.

// Between motor and link: theta - q = tau_J / stiffness. Harmonic drives of this size; N m/rad.
inline constexpr double kJointStiffness = 14250;  // libfranka takes K_theta up to this

// Noise of the sensors, standard deviations. Franka publishes none of the sensors' own; chosen so that at rest the
// estimate of the external force has the noise which the arm's data sheet gives for force (0.035 N), in about equal
// parts from torques and velocities, and so that position is a tenth of what pose repeatability (0.1 mm at 0.855 m)
// would allow.
inline constexpr double kPositionNoise = 1e-5;  // rad
inline constexpr double kVelocityNoise = 1e-4;  // rad/s
inline constexpr double kTorqueNoise = 0.03;    // N m

}  // namespace sim
