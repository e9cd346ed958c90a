#pragma once

#include <algorithm>
#include <array>
#include <span>

#include "realtime/model.hpp"

namespace realtime {

// Of a change of N coordinates: gradient . change >= least (m).
template <int N>
struct Bound {
  Eigen::Matrix<double, N, 1> gradient;
  double least;
};
using JointBound = Bound<7>;            // m/rad
constexpr std::size_t kMostBounds = 32;  // at once

// The change, no longer than 0.1 (rad or m), and then led to within the bound that it lacks most, and so on, where coordinates
// yield by their ease. Most first: what is near leads around what is far.
// `least_square`: what the square of a gradient counts as at least, so that what hardly moves asks for no long step; m²/rad², or 1.
template <int N>
Eigen::Matrix<double, N, 1> past_bounds(const Eigen::Matrix<double, N, 1>& change, const Eigen::Matrix<double, N, 1>& ease,
                                        double least_square, std::span<const Bound<N>> bounds) noexcept {
  constexpr double kLongestStep = 0.1;
  constexpr int kSteps = 100;  // as each changes what the others are about
  Eigen::Matrix<double, N, 1> out = change * std::min(1., kLongestStep / std::max(change.norm(), 1e-9));
  for (int step = 0; step < kSteps; ++step) {
    const Bound<N>* most = nullptr;
    double lack = 0;
    for (const Bound<N>& bound : bounds) {
      const double lacks = bound.least - bound.gradient.dot(out);
      if (lacks > lack) most = &bound, lack = lacks;
    }
    if (most == nullptr) break;
    const Eigen::Matrix<double, N, 1> along = ease.cwiseProduct(most->gradient);
    out += along * (lack / std::max(most->gradient.dot(along), least_square));
  }
  return out;
}

// What of a change of the joints (rad) leads past what they must not come nearer to.
inline Vector7 past_bounds(const Vector7& change, std::span<const JointBound> bounds) noexcept {
  constexpr double kLeastSquare = 1e-4;
  return past_bounds<7>(change, Vector7::Ones(), kLeastSquare, bounds);
}

// The same of a pose (m, rad; axes of O) with which the joints go along; of kMostBounds at most. Turning by a radian costs as much
// as 3 m: what is in the way is passed beside rather than turned away from.
inline Vector6 past_bounds(const Vector6& change, const Matrix76& dq_dP, std::span<const JointBound> bounds) noexcept {
  constexpr double kLeastSquare = 1e-2, kTurningCost = 3;
  Vector6 ease;
  ease << 1, 1, 1, Vector3::Constant(1 / (kTurningCost * kTurningCost));
  std::array<Bound<6>, kMostBounds> of_pose;
  const std::size_t count = std::min(bounds.size(), of_pose.size());
  for (std::size_t k = 0; k < count; ++k) of_pose[k] = {dq_dP.transpose() * bounds[k].gradient, bounds[k].least};
  return past_bounds<6>(change, ease, kLeastSquare, std::span<const Bound<6>>(of_pose.data(), count));
}

}  // namespace realtime
