#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

namespace realtime {

// How a motion from x0, with the velocity v0, to x1 passes in a duration T: x = x0 + (x1 - x0) s(u) + v0 T h(u), u = t/T.
enum class TimeLaw {
  kLinear,        // s = u, h = 0: constant velocity; the limiter rounds its ends
  kSine,          // s = (1 - cos(pi u))/2, h = 0: from rest to rest
  kCubicHermite,  // s = 3u² - 2u³, h = u³ - 2u² + u: with v0 at the start, at rest at the end (cubic Hermite spline)
};

// Values of s and h with their derivatives by u.
struct TimeLawPoint {
  double s, ds, dds, h, dh, ddh;
};

inline TimeLawPoint at(TimeLaw law, double u) {
  u = std::clamp(u, 0.0, 1.0);
  constexpr double pi = std::numbers::pi;
  switch (law) {
    case TimeLaw::kSine:
      return {(1 - std::cos(pi * u)) / 2, pi / 2 * std::sin(pi * u), pi * pi / 2 * std::cos(pi * u), 0, 0, 0};
    case TimeLaw::kCubicHermite:
      return {u * u * (3 - 2 * u), 6 * u * (1 - u), 6 - 12 * u, u * (1 + u * (u - 2)), 1 + u * (3 * u - 4), 6 * u - 4};
    case TimeLaw::kLinear: break;
  }
  return {u, 1, 0, 0, 0, 0};
}

// Greatest values of ds and dds.
inline double peak_velocity(TimeLaw law) {
  return law == TimeLaw::kLinear ? 1 : law == TimeLaw::kSine ? std::numbers::pi / 2 : 1.5;
}
inline double peak_acceleration(TimeLaw law) {
  return law == TimeLaw::kLinear ? 0 : law == TimeLaw::kSine ? std::numbers::pi * std::numbers::pi / 2 : 6;
}


// The shortest duration, s, in which a way from rest (rad or m) keeps to these limits of velocity and acceleration.
inline double least_duration(TimeLaw law, double way, double velocity, double acceleration) {
  return std::max(peak_velocity(law) * way / velocity, std::sqrt(peak_acceleration(law) * way / acceleration));
}

}  // namespace realtime
