#pragma once

#include "realtime/reference.hpp"

namespace realtime {

// x, no longer than that.
inline Vector3 shortened(const Vector3& x, double length) noexcept {
  const double norm = x.norm();
  return norm > length ? Vector3(x * (length / norm)) : x;
}

}  // namespace realtime
