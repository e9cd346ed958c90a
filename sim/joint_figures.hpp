#pragma once

#include <array>

namespace sim {

// What Franka does not publish about its joints, decided here once; joint1 to joint7.

// Inertia of rotor and gear as felt at the joint, kg m². Reflected, FR3's are 0.606, 0.606, 0.462, 0.462, 0.206, 0.206,
// 0.206 (Franka's figures, published with Drake's description of the arm). The robot's joint torque feedback makes them
// appear smaller (Albu-Schäffer, Ott, Hirzinger, A unified passivity-based control framework for position, torque and
// impedance control of flexible joint robots, Int. J. Robotics Research 26(1), 2007); here by six, which is assumed.
inline constexpr std::array<double, 7> kMotorInertia = {0.101, 0.101, 0.077, 0.077, 0.034, 0.034, 0.034};

// Friction which the arm leaves after its own compensation. Coulomb: half the height of the sigmoids which Gaz, Cognetti,
// Oliva, Robuffo Giordano, De Luca (Dynamic identification of the Franka Emika Panda robot with retrieval of feasible
// parameters using penalty-based optimization, IEEE RA-L 4(4), 2019: phi_1 = 0.546, 0.872, 0.641, 1.279, 0.839, 0.303,
// 0.565) found in a Panda's torque sensors, that is behind its compensation. They fit nothing that grows with speed; the
// viscous figure is franka_description's.
inline constexpr std::array<double, 7> kCoulombFriction = {0.273, 0.436, 0.320, 0.640, 0.420, 0.152, 0.282};  // N m
inline constexpr double kViscousFriction = 0.003;                                                            // N m s/rad

// Between motor and link: theta - q = tau_J / stiffness. Harmonic drives of this size; N m/rad.
inline constexpr double kJointStiffness = 14250;  // libfranka takes K_theta up to this

}  // namespace sim
