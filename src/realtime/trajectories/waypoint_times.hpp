#pragma once

#include <cmath>
#include <stdexcept>
#include <string>

#include "realtime/check.hpp"
#include "realtime/trajectories/min_jerk.hpp"
#include "realtime/trajectories/spline.hpp"

namespace realtime {

// Raises `worst` by what a motion through waypoints asks for within a segment; see raise().
template <int N, class RaiseAt>
void raise_in_segment(const CubicSpline<N>& spline, double begin, double end, double& worst, RaiseAt raise_at) {
  constexpr int kParts = 12;  // knots lie at thirds and halves
  for (int k = 0; k <= kParts; ++k) raise_at(spline.at(begin + (end - begin) * k / kParts), worst);
}

// The spline through points at these times, first 0, stretched until raise_at(point, worst) leaves `worst` at 1.
// Returns by what factor.
template <int N, class RaiseAt>
double keep_limits(CubicSpline<N>& spline, std::vector<double> times, RaiseAt raise_at) {
  constexpr int kTries = 8;  // limits may depend on the place alone, so that one is mostly enough
  double factor = 1;
  for (int n = 0; n < kTries; ++n) {
    double worst = 1;
    for (std::size_t k = 1; k < times.size(); ++k) raise_in_segment(spline, times[k - 1], times[k], worst, raise_at);
    if (worst == 1) break;
    worst *= 1.0001;
    spline.stretch(worst);
    for (double& t : times) t *= worst;
    factor *= worst;
  }
  return factor;
}

// Points from the start on, with the times at which they are passed, s; `first` is the first waypoint among them.
template <int N>
struct TimedPoints {
  using Vector = Eigen::Matrix<double, N, 1>;
  std::vector<double> times;
  std::vector<Vector> points;
  std::size_t first = 1;
};

// Changes the times to those at which the spline through the points takes the least time, as far as lengthening and
// shortening its segments by what each asks for finds them.
template <int N, class RaiseAt>
void shorten(TimedPoints<N>& way, RaiseAt raise_at) {
  const int rounds = way.points.size() > 200 ? 15 : 60;  // so that the server is not held up
  constexpr double kLeast = 0.001;  // s, of a segment
  std::vector<double> times = way.times;
  way.times.clear();
  for (int round = 0; round < rounds; ++round) {
    const CubicSpline<N> spline(times, way.points);
    std::vector<double> next(times.size(), 0);
    double most = 0;
    for (std::size_t k = 1; k < times.size(); ++k) {
      double worst = 1e-3;
      raise_in_segment(spline, times[k - 1], times[k], worst, raise_at);
      most = std::max(most, worst);
      next[k] = next[k - 1] + std::max(kLeast, (times[k] - times[k - 1]) * std::clamp(std::sqrt(worst), 0.5, 2.0));
    }
    if (way.times.empty() || most * times.back() < way.times.back()) {
      way.times = times;
      for (double& t : way.times) t *= most;
    }
    times = next;
  }
}

// The points at such times; with others between them, on the way that this makes, where that is faster: then it can go
// along it with a velocity that is more even. For the server room.
template <int N, class RaiseAt>
TimedPoints<N> in_least_time(const std::vector<Eigen::Matrix<double, N, 1>>& points, RaiseAt raise_at) {
  constexpr std::size_t kMost = 200;  // points
  TimedPoints<N> coarse{{}, points};
  for (std::size_t k = 0; k < points.size(); ++k) coarse.times.push_back(static_cast<double>(k));
  shorten(coarse, raise_at);
  TimedPoints<N> best = coarse;
  const CubicSpline<N> spline(coarse.times, points);
  for (const std::size_t parts : {3, 9}) {
    if (points.size() * parts > kMost) break;
    TimedPoints<N> fine{{0}, {points[0]}, parts};
    for (std::size_t k = 1; k < points.size(); ++k) {
      const double begin = coarse.times[k - 1], length = coarse.times[k] - begin;
      for (std::size_t part = 1; part <= parts; ++part) {
        fine.times.push_back(begin + length * static_cast<double>(part) / static_cast<double>(parts));
        fine.points.push_back(part == parts ? points[k] : spline.at(fine.times.back()).x);
      }
    }
    shorten(fine, raise_at);
    if (fine.times.back() < best.times.back()) best = fine;
  }
  return best;
}

// Throws std::invalid_argument unless there are as many times as points, or none, and they increase from above 0.
inline void require_times(const std::vector<double>& times, std::size_t points) {
  if (!times.empty() && times.size() != points) {
    throw std::invalid_argument("times has " + std::to_string(times.size()) + " elements: expected " +
                                std::to_string(points) + ", one for each waypoint, or none");
  }
  for (std::size_t i = 0; i < times.size(); ++i) {
    require_within("times", static_cast<int>(i), times[i], i == 0 ? 1e-3 : times[i - 1] + 1e-3, 3600,
                   i == 0 ? "s" : "s, at least 1 ms after the one before");
  }
}

}  // namespace realtime
