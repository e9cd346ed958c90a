#pragma once

#include "models/joint_figures.hpp"
#include "realtime/reference.hpp"

// Figures of the joints that several tests have.

inline const realtime::Vector7 kStiffness = (realtime::Vector7() << 600, 600, 600, 600, 250, 150, 50).finished();  // N m/rad
inline const realtime::Vector7 kDamping = (realtime::Vector7() << 50, 50, 50, 50, 30, 25, 15).finished();          // N m s/rad
inline const realtime::Vector7 kMotors = realtime::Vector7::Map(models::kMotorInertia.data());                    // kg m²
