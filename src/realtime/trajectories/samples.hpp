#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "realtime/check.hpp"

namespace realtime {

// N coordinates sampled each ms: exact at the samples, between them quintic with the central differences as velocities
// and accelerations, so that these are continuous.
template <int N>
class Samples {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;
  using Table = Eigen::Matrix<double, N, Eigen::Dynamic>;

  static constexpr double kPeriod = 0.001;  // s
  static constexpr int kMost = 120000;

  struct Point {
    Vector x, v, a;
  };

  explicit Samples(Table samples) : x_(std::move(samples)) {
    require_within("number of samples", -1, static_cast<double>(x_.cols()), 3, kMost, "");
  }

  double duration() const { return static_cast<double>(x_.cols() - 1) * kPeriod; }
  const Table& table() const { return x_; }

  Point at(double t) const {
    const double place = std::clamp(t, 0.0, duration()) / kPeriod;
    const auto k = std::min(static_cast<Eigen::Index>(place), x_.cols() - 2);
    const double u = place - static_cast<double>(k), h = kPeriod;
    const Vector v0 = change(k), v1 = change(k + 1), a0 = bend(k), a1 = bend(k + 1);  // for each sample
    const Vector A = x_.col(k + 1) - x_.col(k) - v0 - a0 / 2, B = v1 - v0 - a0, C = a1 - a0;
    const Vector c3 = 10 * A - 4 * B + C / 2, c4 = -15 * A + 7 * B - C, c5 = 6 * A - 3 * B + C / 2;
    return {x_.col(k) + u * (v0 + u * (a0 / 2 + u * (c3 + u * (c4 + u * c5)))),
            (v0 + u * (a0 + u * (3 * c3 + u * (4 * c4 + u * 5 * c5)))) / h,
            (a0 + u * (6 * c3 + u * (12 * c4 + u * 20 * c5))) / (h * h)};
  }

  // Calls visit(x, v, a) all along, of the motion in steps of 10 ms: what is faster is noise, which the limiter
  // smooths.
  template <class Visit>
  void visit_rates(Visit visit) const {
    const Eigen::Index step = std::min<Eigen::Index>((x_.cols() - 1) / 2, 10);
    const double h = static_cast<double>(step) * kPeriod;
    for (Eigen::Index k = 0; k + step < x_.cols(); ++k) {
      const Eigen::Index next = std::min(k + 2 * step, x_.cols() - 1);
      visit(Vector(x_.col(k + step)), Vector((x_.col(k + step) - x_.col(k)) / h),
            Vector((x_.col(next) - 2 * x_.col(k + step) + x_.col(k)) / (h * h) * (next == k + 2 * step)));
    }
  }

 private:
  // Before the first and after the last, by the parabola through the three that are next.
  Vector column(Eigen::Index k) const {
    const Eigen::Index last = x_.cols() - 1;
    if (k < 0) return 3 * (x_.col(0) - x_.col(1)) + x_.col(2);
    if (k > last) return 3 * (x_.col(last) - x_.col(last - 1)) + x_.col(last - 2);
    return x_.col(k);
  }
  Vector change(Eigen::Index k) const { return (column(k + 1) - column(k - 1)) / 2; }
  Vector bend(Eigen::Index k) const { return column(k + 1) - 2 * column(k) + column(k - 1); }

  Table x_;
};

}  // namespace realtime
