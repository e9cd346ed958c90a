#pragma once

#include "realtime/reference.hpp"

namespace realtime {

// Derivatives by the time of a path become those by a clock against which that time goes at `rate`, changing by `change` (1/s).
inline void slow(Reference& reference, double rate, double change) noexcept {
  const auto slow = [&](auto& velocity, auto& acceleration) {
    acceleration = rate * rate * acceleration + change * velocity;
    velocity *= rate;
  };
  slow(reference.joint.dq, reference.joint.ddq);
  slow(reference.cartesian.velocity, reference.cartesian.acceleration);
}

}  // namespace realtime
