#pragma once

#include <limits>

#include "models/arm.hpp"

namespace realtime {

// What keeps motions and torques that are asked for below the limits of the arm; it may change at any time. Braking, and what
// keeps the arm from walls and from the ends of its joints, go by the arm's own limits, so that they are never weaker for these.
struct Bounds {
  explicit Bounds(const models::Limits& of) : limits(of) {}

  models::Limits limits;  // each at most the arm's
  double tool_speed = std::numeric_limits<double>::infinity();  // m/s, of the origin of EE
  double power = std::numeric_limits<double>::infinity();       // W, that the joints do beside gravity and friction
};

}  // namespace realtime
