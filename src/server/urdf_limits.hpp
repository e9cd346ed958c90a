#pragma once

#include <string>

#include "models/arm.hpp"

namespace server {

// Limits of an arm and what the robot's own URDF (protocol 8 and later) states of ranges, velocities and torques: of both the
// narrower. The robot knows what it takes, so that nothing beyond its figures is commanded; and a table is of the newest system
// of its protocol version, so that no robot takes more than its table: a wider figure in a URDF is one that somebody has edited,
// or one of hardware alone. Throws std::invalid_argument for what is no URDF, and where nothing of a joint's range is left.
models::Limits narrowed(models::Limits limits, const std::string& urdf);

}  // namespace server
