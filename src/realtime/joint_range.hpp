#pragma once

#include "models/arm.hpp"

namespace realtime {

// Where joint i may come to rest, rad: its range, less what FR3's velocity envelope closes (towards a
// limit it allows no motion well before the limit itself).
double rest_min(const models::Limits& limits, int i);
double rest_max(const models::Limits& limits, int i);

}  // namespace realtime
