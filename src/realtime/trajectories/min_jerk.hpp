#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "models/arm.hpp"
#include "realtime/tick.hpp"

namespace realtime {

// Limits of joint i.
inline models::Limits::Rates rates(const models::Limits& limits, int i) {
  return {limits.dq_max[i], limits.ddq_max[i], limits.dddq_max[i]};
}

// Share of the arm's limits that a timed motion is stretched to.
inline constexpr double kMotionShare = 0.94;

// From (x0, v0, a0) to rest at x1. From rest: the motion of least jerk,
//   x = x0 + (x1 - x0) (10 s^3 - 15 s^4 + 6 s^5), s = t/T
// (Flash and Hogan, The Coordination of Arm Movements, J. Neurosci. 5(7), 1985, appendix A). A motion
// that begins moving is the sum of that and of a decay of v0 and a0 (velocity cubic in time) within
// `decay` seconds, wherever that leads: a single quintic would carry v0 along for all of T, and lead up
// to 0.18 v0 T away from both ends. Position, velocity and acceleration are continuous.
template <int N>
class MinJerk {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;

  struct Point {
    Vector x, v, a, j;
    Vector v_timed;  // share of v that a longer duration makes smaller
  };

  void start(const Vector& x0, const Vector& v0, const Vector& a0, const Vector& x1, double decay) {
    x0_ = x0;
    v0_ = v0;
    a0_ = a0;
    decay_ = v0.isZero(0) && a0.isZero(0) ? 0 : decay;
    way_ = x1 - x0 - decay_ * (v0 / 2 + decay_ / 12 * a0);
  }

  void set_duration(double T) { T_ = std::max(T, kTick); }  // s; at least a cycle, also where there is no way
  double duration() const { return std::max(T_, decay_); }
  bool moving() const { return decay_ > 0; }

  // The way of the timed part alone, x1 - x0 from rest.
  const Vector& way() const { return way_; }

  Point at(double t) const {
    const double s = std::clamp(t / T_, 0.0, 1.0);
    Point point;
    point.x = x0_ + way_ * (s * s * s * (10 + s * (-15 + s * 6)));
    point.v_timed = way_ * (30 * s * s * (1 + s * (-2 + s)) / T_);
    point.v = point.v_timed;
    point.a = way_ * (60 * s * (1 + s * (-3 + s * 2)) / (T_ * T_));
    point.j = way_ * (60 * (1 + s * (-6 + s * 6)) / (T_ * T_ * T_));
    if (decay_ > 0) {
      const double d = decay_;
      const double u = std::clamp(t / d, 0.0, 1.0);
      point.x += v0_ * (d * u * (1 + u * u * (-1 + u / 2))) + a0_ * (d * d * u * u * (0.5 + u * (-2.0 / 3 + u / 4)));
      if (u < 1) {
        point.v += v0_ * (1 + u * u * (-3 + 2 * u)) + a0_ * (d * u * (1 + u * (-2 + u)));
        point.a += v0_ * (6 * u * (u - 1) / d) + a0_ * (1 + u * (-4 + 3 * u));
        point.j += v0_ * (6 * (2 * u - 1) / (d * d)) + a0_ * ((6 * u - 4) / d);
      }
    }
    return point;
  }

 private:
  Vector x0_, v0_, a0_, way_;
  double T_ = 1;
  double decay_ = 0;
};

// Least duration of the motion from rest over `distance`, s: its peaks are 15/8 d/T, 10/sqrt(3) d/T²
// and 60 d/T³.
inline double least_duration(double distance, const models::Limits::Rates& limits) {
  return std::max({1.875 * distance / (kMotionShare * limits.velocity),
                   std::sqrt(10 / std::sqrt(3.0) * distance / (kMotionShare * limits.acceleration)),
                   std::cbrt(60 * distance / (kMotionShare * limits.jerk))});
}

// Of the way on which a path leads an arm back to it, s: where that sags by tenths of a millimetre, the least is a jerk.
inline double fade_duration(double distance, const models::Limits::Rates& limits) {
  constexpr double kGentle = 0.05, kLongest = 0.1;  // of the acceleration; s
  const double gently = least_duration(distance, {limits.velocity, kGentle / kMotionShare * limits.acceleration, limits.jerk});
  return std::max(least_duration(distance, limits), std::min(gently, kLongest));
}

// Time for the decay of v and a, s: half of the acceleration and a quarter of the jerk are used for it.
inline double decay_duration(double v, double a, const models::Limits::Rates& limits) {
  return std::max({3 * v / limits.acceleration, std::sqrt(24 * v / limits.jerk), 16 * a / limits.jerk});
}

// Raises `worst`, a factor by which a duration should grow, to what these shares of the allowed velocity,
// acceleration and jerk ask for.
inline void raise(double& worst, double velocity, double acceleration, double jerk) {
  if (velocity > worst) worst = velocity;
  if (acceleration > worst * worst) worst = std::sqrt(acceleration);
  if (jerk > worst * worst * worst) worst = std::cbrt(jerk);
}

// Lengthens the motion until `raise_at(t, worst)` leaves `worst` at 1 at all samples; each try scales by
// what the worst asks for. Bounded, as it runs in the loop: the limiter holds what is left over.
template <class SetDuration, class RaiseAt>
void stretch(double& T, SetDuration set_duration, RaiseAt raise_at) {
  constexpr int kTries = 10;
  constexpr int kSamples = 48;
  for (int n = 0; n < kTries; ++n) {
    const double duration = set_duration(T);
    double worst = 1;
    for (int k = 0; k <= kSamples; ++k) raise_at(duration * k / kSamples, worst);
    if (worst == 1) return;
    T *= std::min(1.002 * worst, 4.0);
  }
  set_duration(T);
}

}  // namespace realtime
