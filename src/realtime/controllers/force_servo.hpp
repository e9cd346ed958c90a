#pragma once

#include <algorithm>
#include <cmath>

#include "realtime/reference.hpp"

namespace realtime {

// One axis of force control: feed-forward of the force wanted, with a proportional and an integral part on what is missing
// of it, and a damping:
//   f = c - D v,   c = wanted + g (wanted - felt) + i,   di/dt = g_I (wanted - felt)
// c is at most what the surroundings push back plus D v_max: where nothing is touched, EE goes at v_max and no faster, and
// when it touches, the force rises as fast as it is felt to. The integral works in contact, while c is not held back, and
// never asks for more than half of the force wanted. D = 60 1/s times the inertia that EE has along the axis.
class ForceServo {
 public:
  void start() noexcept { integral_ = 0; }

  // D, N s/m of kg, or N m s/rad of kg m².
  static double damping(double inertia) noexcept { return kDampingRate * inertia; }

  // N, m/s, kg, or N m, rad/s, kg m²; felt: what EE exerts; gains: 1 and 1/s; dt in s.
  double step(double wanted, double felt, double v, double v_max, double inertia, double gain, double integral_gain,
              double dt) noexcept {
    const double missing = wanted - felt;
    const double D = damping(inertia);
    const double asked = wanted + gain * missing + integral_;
    const double pushed_back = asked > 0 ? std::max(felt, 0.0) : std::max(-felt, 0.0);
    const double most = pushed_back + D * v_max;
    const bool in_contact = felt * wanted > kContact * wanted * wanted;
    if (!in_contact) {
      integral_ = 0;
    } else if (std::abs(asked) <= most) {
      const double bound = kMostIntegral * std::abs(wanted);
      integral_ = std::clamp(integral_ + integral_gain * missing * dt, -bound, bound);
    }
    return std::clamp(asked, -most, most) - D * v;
  }

 private:
  static constexpr double kDampingRate = 60;    // 1/s
  static constexpr double kContact = 0.3;       // of the force wanted
  static constexpr double kMostIntegral = 0.5;  // of the force wanted

  double integral_ = 0;
};

}  // namespace realtime
