#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <vector>

namespace realtime {

// Cubic spline of N coordinates through points at given times, from rest to rest: position, velocity and acceleration
// are continuous, velocity and acceleration are zero at both ends. These four conditions have two knots more, whose
// positions are free, within the first and the last segment (Biagiotti, Melchiorri, Trajectory Planning for Automatic
// Machines and Robots, 2008, section 4.4.4). Allocates when it is made; it is read without.
template <int N>
class CubicSpline {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;

  struct Point {
    Vector x, v, a, j;
  };

  // At least two points; as many times, s, increasing from 0.
  CubicSpline(const std::vector<double>& times, const std::vector<Vector>& points) {
    const std::size_t last = points.size() - 1;
    for (std::size_t i = 0; i <= last; ++i) {
      if (i == last) add((times[i - 1] + (last == 1 ? 2 : 1) * times[i]) / (last == 1 ? 3 : 2), points[i]);
      add(times[i], points[i]);
      if (i == 0) add((times[0] * (last == 1 ? 2 : 1) + times[1]) / (last == 1 ? 3 : 2), points[0]);
    }
    solve();
  }

  double duration() const { return t_.back(); }
  void stretch(double factor) {
    for (double& t : t_) t *= factor;
    for (Vector& a : a_) a /= factor * factor;
  }

  Point at(double t) const {
    t = std::clamp(t, 0.0, duration());
    const auto after = std::upper_bound(t_.begin() + 1, t_.end() - 1, t);
    const std::size_t i = static_cast<std::size_t>(after - t_.begin()) - 1;
    const double h = t_[i + 1] - t_[i], d = t - t_[i];
    const Vector j = (a_[i + 1] - a_[i]) / h;
    const Vector v = (x_[i + 1] - x_[i]) / h - h / 6 * (2 * a_[i] + a_[i + 1]);
    return {x_[i] + d * (v + d * (a_[i] / 2 + d / 6 * j)), v + d * (a_[i] + d / 2 * j), a_[i] + d * j, j};
  }

 private:
  void add(double t, const Vector& x) {
    t_.push_back(t);
    x_.push_back(x);
  }

  // Accelerations at the inner knots, from velocities that are continuous there: a tridiagonal system. The free
  // positions are x_1 = x_0 + h_0²/6 a_1, and likewise at the end; x_ holds their first terms until they are known.
  void solve() {
    const std::size_t m = t_.size() - 1;
    const auto h = [this](std::size_t i) { return t_[i + 1] - t_[i]; };
    std::vector<double> diagonal(m), lower(m), upper(m);
    a_.assign(m + 1, Vector::Zero());
    for (std::size_t i = 1; i < m; ++i) {
      lower[i] = h(i - 1);
      diagonal[i] = 2 * (h(i - 1) + h(i));
      upper[i] = h(i);
      a_[i] = 6 * ((x_[i + 1] - x_[i]) / h(i) - (x_[i] - x_[i - 1]) / h(i - 1));
    }
    const double first = h(0) * h(0), final = h(m - 1) * h(m - 1);
    diagonal[1] += first * (1 / h(0) + 1 / h(1));
    lower[2] -= first / h(1);
    diagonal[m - 1] += final * (1 / h(m - 1) + 1 / h(m - 2));
    upper[m - 2] -= final / h(m - 2);
    for (std::size_t i = 2; i < m; ++i) {
      const double share = lower[i] / diagonal[i - 1];
      diagonal[i] -= share * upper[i - 1];
      a_[i] -= share * a_[i - 1];
    }
    for (std::size_t i = m - 1; i > 0; --i) {
      if (i + 1 < m) a_[i] -= upper[i] * a_[i + 1];
      a_[i] /= diagonal[i];
    }
    x_[1] += first / 6 * a_[1];
    x_[m - 1] += final / 6 * a_[m - 1];
  }

  std::vector<double> t_;      // s, of the knots
  std::vector<Vector> x_, a_;  // there
};

}  // namespace realtime
