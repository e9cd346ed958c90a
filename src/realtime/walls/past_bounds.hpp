#pragma once

#include <algorithm>
#include <array>
#include <span>

#include "realtime/model.hpp"

namespace realtime {

// Of a change of the joints: gradient . change >= least (m).
struct JointBound {
  Vector7 gradient;  // m/rad
  double least;
};

namespace past_bounds_detail {

constexpr double kLongestStep = 0.1;  // rad or m that such a motion looks ahead
constexpr int kPasses = 10;           // through the bounds, as each changes what the others are about

// The change, no longer than kLongestStep, and then led to within each bound in turn, where coordinates yield by their ease.
// `least_square`: what the square of a gradient counts as at least, so that what hardly moves asks for no long step; m²/rad², or 1.
template <int N, typename GradientOf>
Eigen::Matrix<double, N, 1> past(const Eigen::Matrix<double, N, 1>& change, const Eigen::Matrix<double, N, 1>& ease,
                                 double least_square, std::span<const JointBound> bounds, GradientOf gradient_of) noexcept {
  Eigen::Matrix<double, N, 1> out = change * std::min(1., kLongestStep / std::max(change.norm(), 1e-9));
  for (int pass = 0; pass < kPasses; ++pass) {
    for (const JointBound& bound : bounds) {
      const Eigen::Matrix<double, N, 1> gradient = gradient_of(bound);
      const double lack = bound.least - gradient.dot(out);
      if (lack <= 0) continue;
      const Eigen::Matrix<double, N, 1> along = ease.cwiseProduct(gradient);
      out += along * (lack / std::max(gradient.dot(along), least_square));
    }
  }
  return out;
}

}  // namespace past_bounds_detail

// What of a change of the joints (rad) leads past what they must not come nearer to.
inline Vector7 past_bounds(const Vector7& change, std::span<const JointBound> bounds) noexcept {
  constexpr double kLeastSquare = 1e-4;
  return past_bounds_detail::past<7>(change, Vector7::Ones(), kLeastSquare, bounds,
                                     [](const JointBound& bound) -> const Vector7& { return bound.gradient; });
}

// The same of a pose (m, rad; axes of O) with which the joints go along. Turning by a radian costs as much as 3 m: what is in the way
// is passed beside rather than turned away from.
inline Vector6 past_bounds(const Vector6& change, const Matrix76& dq_dP, std::span<const JointBound> bounds) noexcept {
  constexpr double kLeastSquare = 1e-2, kTurningCost = 3;
  Vector6 ease;
  ease << 1, 1, 1, Vector3::Constant(1 / (kTurningCost * kTurningCost));
  return past_bounds_detail::past<6>(change, ease, kLeastSquare, bounds,
                                     [&](const JointBound& bound) -> Vector6 { return dq_dP.transpose() * bound.gradient; });
}

}  // namespace realtime
