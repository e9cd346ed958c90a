#pragma once

#include <algorithm>
#include <cmath>

#include "models/arm.hpp"
#include "realtime/reference.hpp"

namespace realtime {

// What of a way, from a place on, lies between bounds on each side: a share of all of it, at most 1 and 0 where it begins beyond.
inline double share_inside(const Vector7& from, const Vector7& way, const Vector7& least, const Vector7& most) noexcept {
  double share = 1;
  for (int i = 0; i < models::kJoints; ++i) {
    const double room = way[i] > 0 ? most[i] - from[i] : from[i] - least[i];
    if (room < share * std::abs(way[i])) share = std::max(room, 0.) / std::abs(way[i]);
  }
  return share;
}

}  // namespace realtime
