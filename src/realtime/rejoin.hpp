#pragma once

#include <algorithm>
#include <cmath>

#include "models/arm.hpp"
#include "realtime/reference.hpp"
#include "realtime/rotation.hpp"
#include "realtime/tick.hpp"
#include "realtime/trajectories/min_jerk.hpp"

namespace realtime {

// Leads a reference that has drifted off its trajectory back to it. While states are lost the robot moves the
// reference on with constant acceleration; at the next command the difference in position, velocity and
// acceleration is added to the trajectory and decays to zero along a quintic polynomial of time. Catching
// up as fast as the limits permit would instead answer each loss with the full jerk, and the next loss would
// carry that on. A difference so great that this asks for more than the limits allow is left to them: what they
// hold back is not zero in its time, and after the next loss this would ask for still more.
class Rejoin {
 public:
  explicit Rejoin(const models::Limits& limits) : limits_(limits) {}

  // `is` and `wanted` belong to the same moment.
  void start(const Reference& is, const Reference& wanted) noexcept {
    bool asks_too_much = false;
    const auto see = [&asks_too_much](double x, double v, double a, const models::Limits::Rates& most) {
      constexpr double T = kDuration;
      // The greatest accelerations of the three parts of the polynomial, and their jerks, which are greatest at its start.
      asks_too_much |= std::max({10 / std::sqrt(3.) * x / (T * T), 4 * v / T, a}) > most.acceleration ||
                       std::max({60 * x / (T * T * T), 36 * v / (T * T), 9 * a / T}) > most.jerk;
    };
    if (is.motion == Channels::kJoint) {
      x_ = is.joint.q - wanted.joint.q;
      v_ = is.joint.dq - wanted.joint.dq;
      a_ = is.joint.ddq - wanted.joint.ddq;
      for (int i = 0; i < models::kJoints; ++i) see(std::abs(x_[i]), std::abs(v_[i]), std::abs(a_[i]), rates(limits_, i));
    } else {
      x_ << is.cartesian.position - wanted.cartesian.position,
          log(is.cartesian.orientation * wanted.cartesian.orientation.conjugate()), 0;
      v_ << is.cartesian.velocity - wanted.cartesian.velocity, 0;
      a_ << is.cartesian.acceleration - wanted.cartesian.acceleration, 0;
      see(x_.head<3>().norm(), v_.head<3>().norm(), a_.head<3>().norm(), limits_.translation);
      see(x_.segment<3>(3).norm(), v_.segment<3>(3).norm(), a_.segment<3>(3).norm(), limits_.rotation);
    }
    left_ = asks_too_much ? 0 : kDuration;
    const auto most = [](const Vector7& d) { return d.cwiseAbs().maxCoeff(); };
    if (most(x_) < kNothing && most(v_) < kNothing / kTick && most(a_) < kNothing / (kTick * kTick)) left_ = 0;
  }
  void stop() noexcept { left_ = 0; }
  bool active() const noexcept { return left_ > 0; }

  // Adds what is left of the difference `dt` seconds later.
  void step(double dt, Reference& wanted) noexcept {
    left_ -= dt;
    if (left_ <= dt / 2) {
      left_ = 0;
      return;
    }
    constexpr double T = kDuration;
    const double s = 1 - left_ / T;
    const double s2 = s * s, s3 = s2 * s;
    const Vector7 x = (1 + s3 * (-10 + s * (15 - 6 * s))) * x_ + T * s * (1 + s2 * (-6 + s * (8 - 3 * s))) * v_ +
                      T * T / 2 * s2 * (1 + s * (-3 + s * (3 - s))) * a_;
    const Vector7 v = s2 * (-30 + s * (60 - 30 * s)) / T * x_ + (1 + s2 * (-18 + s * (32 - 15 * s))) * v_ +
                      T / 2 * s * (2 + s * (-9 + s * (12 - 5 * s))) * a_;
    const Vector7 a = s * (-60 + s * (180 - 120 * s)) / (T * T) * x_ + s * (-36 + s * (96 - 60 * s)) / T * v_ +
                      (1 + s * (-9 + s * (18 - 10 * s))) * a_;
    if (wanted.motion == Channels::kJoint) {
      wanted.joint.q += x;
      wanted.joint.dq += v;
      wanted.joint.ddq += a;
    } else {
      wanted.cartesian.position += x.head<3>();
      wanted.cartesian.orientation = (exp(x.segment<3>(3)) * wanted.cartesian.orientation).normalized();
      wanted.cartesian.velocity += v.head<6>();
      wanted.cartesian.acceleration += a.head<6>();
    }
  }

 private:
  static constexpr double kDuration = 0.05;  // s
  static constexpr double kNothing = 1e-9;   // rad or m: steps over this within a cycle are rest for the limiter

  models::Limits limits_;
  double left_ = 0;    // s
  Vector7 x_, v_, a_;  // differences at the start; poses use six
};

}  // namespace realtime
