#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "realtime/check.hpp"
#include "realtime/trajectories/min_jerk.hpp"

namespace realtime {

// Dynamic movement primitives (Ijspeert, Nakanishi, Hoffmann, Pastor, Schaal, Dynamical Movement Primitives: Learning
// Attractor Models for Motor Behaviors, Neural Computation 25(2), 2013): in each dimension a damped spring about the
// start, which a learned force leads away from it,
//
//   y'' = tau² (alpha (beta (y0 - y) - y'/tau) + alpha beta f(x)),  x' = -tau x, x(0) = 1
//   f(x) = sum over sensors s and basis functions k of v_s w_sk phi_k(x)
//   phi_k = x exp(-h_k (x - mu_k)²) / sum of the exponentials
//
// and phi_0 is not of this sum (but with kGaussian): kMinJerk, 10 u³ - 15 u⁴ + 6 u⁵ with u = min(2 tau t, 1); kGoal, 1.
// So v w_0 is how far the dimension ends from its start.
//
// The spring is linear: the motion is that from rest at the start, which does not depend on the start, and the response
// to a velocity at the start. Both are computed at construction, and the end is known as soon as the start is. Values of
// sensors that change meanwhile: dmp_sensors.hpp.

enum class FirstBasis { kMinJerk, kGoal, kGaussian };

// What was learned, of all dimensions.
struct DmpForce {
  std::vector<double> mu, h;
  std::vector<double> weights;  // of each dimension, in it of each sensor, in it of each basis function
  std::vector<double> initial_sensor_values;  // v_s; none: 1
  std::optional<std::string> topic{};         // over which they come anew while the motion runs
};

struct DmpSpring {
  double tau;          // 1/s
  double alpha, beta;  // without unit
};

// f of N dimensions: of all sensors at their initial values or, where these will change, of each at the value 1.
template <int N>
class DmpForcing {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;

  // Sensor values are of each dimension, or the same for all of them. `prefix` stands before the fields' names. Throws
  // std::invalid_argument which says what has another size than expected.
  DmpForcing(const std::string& prefix, const DmpForce& force, FirstBasis first, bool values_of_each_dimension)
      : first_(first), mu_(force.mu), h_(force.h) {
    constexpr std::size_t kMost = 100;
    const std::size_t basis = mu_.size(), dimensions = N;
    if (basis < 1 || basis > kMost) refuse(prefix + "mu", basis, "1 to 100");
    if (h_.size() != basis) refuse(prefix + "h", h_.size(), std::to_string(basis) + ", as mu has");
    const std::size_t values = force.initial_sensor_values.size(), of = values_of_each_dimension ? dimensions : 1;
    const std::size_t sensors = values == 0 ? force.weights.size() / (dimensions * basis) : values / of;
    if (values % of != 0) refuse("initial_sensor_values", values, "a multiple of " + std::to_string(of));
    if (sensors < 1 || sensors > kMost || force.weights.size() != dimensions * sensors * basis) {
      refuse(prefix + "weights", force.weights.size(),
             std::to_string(dimensions * basis) +
                 ", one for each dimension and basis function, for each of at most 100 sensors");
    }
    if (force.topic && sensors > kMostLive) refuse("sensors with a topic", sensors, "at most " + std::to_string(kMostLive));
    weights_.assign(force.topic ? sensors : 1, Weights::Zero(N, static_cast<int>(basis)));
    values_ = Values::Ones(N, static_cast<int>(weights_.size()));
    for (std::size_t k = 0; k < basis; ++k) {
      require_within(prefix + "mu", static_cast<int>(k), mu_[k], -1e3, 1e3, "");
      require_within(prefix + "h", static_cast<int>(k), h_[k], 0, 1e12, "");
    }
    for (std::size_t i = 0; i < dimensions; ++i) {
      for (std::size_t s = 0; s < sensors; ++s) {
        const std::size_t at = values_of_each_dimension ? i * sensors + s : s;
        const double value = values == 0 ? 1 : force.initial_sensor_values[at];
        require_within("initial_sensor_values", static_cast<int>(at), value, -1e6, 1e6, "");
        for (std::size_t k = 0; k < basis; ++k) {
          const std::size_t index = (i * sensors + s) * basis + k;
          require_within(prefix + "weights", static_cast<int>(index), force.weights[index], -1e6, 1e6, "");
          weights_[force.topic ? s : 0](static_cast<int>(i), static_cast<int>(k)) += (force.topic ? 1 : value) * force.weights[index];
        }
        if (force.topic) values_(static_cast<int>(i), static_cast<int>(s)) = value;
      }
    }
  }

  using Values = Eigen::Matrix<double, N, Eigen::Dynamic>;

  // Initial ones, of each dimension and sensor; without a topic there is one sensor, of the value 1.
  const Values& values() const { return values_; }
  int sensors() const { return static_cast<int>(weights_.size()); }

  // `u`: of the first basis function; both from 0.
  Vector at(double x, double u, int sensor = 0) const {
    const Weights& weights = weights_[static_cast<std::size_t>(sensor)];
    constexpr double kLeast = 1e-8;  // where no basis function is near
    double sum = kLeast;
    Vector f = Vector::Zero();
    for (std::size_t k = first_ == FirstBasis::kGaussian ? 0 : 1; k < mu_.size(); ++k) {
      const double psi = std::exp(-h_[k] * (x - mu_[k]) * (x - mu_[k]));
      sum += psi;
      f += psi * weights.col(static_cast<int>(k));
    }
    f *= x / sum;
    u = std::min(u, 1.0);
    if (first_ == FirstBasis::kMinJerk) f += u * u * u * (10 + u * (-15 + u * 6)) * weights.col(0);
    if (first_ == FirstBasis::kGoal) f += weights.col(0);
    return f;
  }

 private:
  using Weights = Eigen::Matrix<double, N, Eigen::Dynamic>;
  static constexpr std::size_t kMostLive = 8;  // sensors, each of which has a rollout

  [[noreturn]] static void refuse(const std::string& field, std::size_t size, const std::string& expected) {
    throw std::invalid_argument(field + " has " + std::to_string(size) + " elements: expected " + expected);
  }

  FirstBasis first_;
  std::vector<double> mu_, h_;
  std::vector<Weights> weights_;  // of each sensor
  Values values_;
};

// The springs of N dimensions for a while, a table that is read at any time: at steps of 1 ms, of those that last longer than
// 20 s at 20 000 steps, so that the server is not held up.
template <int N>
class DmpRollout {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;

  // Of all dimensions from rest at 0; and of one of them without a force, that begins with velocity 1, or at 1.
  struct Point {
    Vector forced;
    double from_velocity, from_position;
  };
  struct Rates {
    Point x, v, a;
  };

  // `force(t)`: f at t (s). Throws std::invalid_argument where the springs are too stiff for the step.
  template <class Force>
  DmpRollout(const std::string& prefix, const DmpSpring& spring, double duration, Force force)
      : steps_(static_cast<std::size_t>(std::ceil(std::min(duration / kStep, kMostSteps)))), step_(duration / static_cast<double>(steps_)) {
    const double stiffness = spring.alpha * spring.beta * spring.tau * spring.tau, damping = spring.alpha * spring.tau;
    require_within("natural frequency of " + prefix + "tau, alpha and beta", -1,
                   std::max(damping, std::sqrt(stiffness)), 0, kFastest / step_, "1/s");
    x_.reserve(steps_ + 1);
    v_.reserve(steps_ + 1);
    State x = State::Zero(), v = State::Zero();
    v[N] = 1;
    x[N + 1] = 1;
    const auto acceleration = [&](const State& x, const State& v, const Vector& f) {
      State a = -stiffness * x - damping * v;
      a.template head<N>() += stiffness * f;
      return a;
    };
    // Runge-Kutta of order 4
    Vector f = force(0);
    for (std::size_t k = 0;; ++k) {
      x_.push_back(x);
      v_.push_back(v);
      if (k == steps_) break;
      const double t = static_cast<double>(k) * step_, h = step_;
      const Vector middle = force(t + h / 2), next = force(t + h);
      const State a1 = acceleration(x, v, f);
      const State v2 = v + h / 2 * a1, a2 = acceleration(x + h / 2 * v, v2, middle);
      const State v3 = v + h / 2 * a2, a3 = acceleration(x + h / 2 * v2, v3, middle);
      const State v4 = v + h * a3, a4 = acceleration(x + h * v3, v4, next);
      x += h / 6 * (v + 2 * v2 + 2 * v3 + v4);
      v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
      f = next;
    }
  }

  double duration() const { return static_cast<double>(steps_) * step_; }

  // Cubic between two steps, so that the rates are those of the positions.
  Rates at(double t) const {
    const double place = std::clamp(t / step_, 0.0, static_cast<double>(steps_));
    const std::size_t k = std::min(static_cast<std::size_t>(place), steps_ - 1);
    const double u = place - static_cast<double>(k), h = step_;
    const State way = x_[k + 1] - x_[k], &v0 = v_[k], &v1 = v_[k + 1];
    const State x = x_[k] + u * u * (3 - 2 * u) * way + h * u * ((1 - u) * (1 - u) * v0 - u * (1 - u) * v1);
    const State v = 6 * u * (1 - u) / h * way + (1 - u) * (1 - 3 * u) * v0 + u * (3 * u - 2) * v1;
    const State a = ((6 - 12 * u) / h * way + (6 * u - 4) * v0 + (6 * u - 2) * v1) / h;
    return {split(x), split(v), split(a)};
  }

  std::size_t steps() const { return steps_; }

 private:
  static constexpr double kStep = 0.001;  // s
  static constexpr double kMostSteps = 20000;
  static constexpr double kFastest = 0.5;  // of a step's rate, at which the steps are still good
  using State = Eigen::Matrix<double, N + 2, 1>;

  static Point split(const State& s) { return {s.template head<N>(), s[N], s[N + 1]}; }

  std::size_t steps_;
  double step_;
  std::vector<State> x_, v_;
};

// Calls visit(v, a, j) at all steps; j is that since the step before, so that it leaves out how the motion begins.
template <class Rollout, class Visit>
void visit_rates(const Rollout& rollout, Visit visit) {
  const double step = rollout.duration() / static_cast<double>(rollout.steps());
  auto last = rollout.at(0).a;
  for (std::size_t k = 0; k <= rollout.steps(); ++k) {
    const auto now = rollout.at(static_cast<double>(k) * step);
    visit(now.v, now.a, typename Rollout::Vector((now.a.forced - last.forced) / step));
    last = now.a;
  }
}

// A rollout from a start, on a clock that is slower by a factor; where it is cut off it comes to rest by a decay.
template <int N, class Rollout = DmpRollout<N>>
class DmpMotion {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;

  struct Point {
    Vector y, dy, ddy;
  };

  // From base + offset, where the springs pull to `base`, with the velocity dy0. The rollout must outlive the motion.
  void start(const Rollout& rollout, const Vector& base, const Vector& offset, const Vector& dy0, double slower) {
    rollout_ = &rollout;
    base_ = base;
    offset_ = offset;
    dy0_ = dy0;
    slower_ = slower;
  }

  double cut() const { return slower_ * rollout_->duration(); }
  Point at_cut() const { return at_clock(rollout_->duration()); }

  // Comes to rest within `decay` seconds; returns where.
  Vector come_to_rest(double decay) {
    const Point end = at_cut();
    const Vector goal = end.y + decay * (end.dy / 2 + decay / 12 * end.ddy);
    rest_.start(end.y, end.dy, end.ddy, goal, decay);
    rest_.set_duration(decay);
    duration_ = cut() + decay;
    return goal;
  }

  // The same after the rollout has changed.
  Vector come_to_rest() { return come_to_rest(duration_ - cut()); }

  double duration() const { return duration_; }
  double clock(double t) const { return t / slower_; }

  Point at(double t) const {
    if (t < cut()) return at_clock(clock(t));
    const auto point = rest_.at(t - cut());
    return {point.x, point.v, point.a};
  }

 private:
  Point at_clock(double t) const {
    const auto r = rollout_->at(t);
    const double s = slower_;
    return {base_ + r.x.forced + r.x.from_position * offset_ + s * r.x.from_velocity * dy0_,
            (r.v.forced + r.v.from_position * offset_) / s + r.v.from_velocity * dy0_,
            (r.a.forced + r.a.from_position * offset_) / (s * s) + r.a.from_velocity / s * dy0_};
  }

  const Rollout* rollout_ = nullptr;
  Vector base_, offset_, dy0_;
  double slower_ = 1, duration_ = 0;
  MinJerk<N> rest_;
};

// By what factor a motion should be slower to have these rates within a share of the limits.
inline double slower(double v, double a, double j, const models::Limits::Rates& limits) {
  double worst = 1;
  raise(worst, v / (kMotionShare * limits.velocity), a / (kMotionShare * limits.acceleration),
        j / (kMotionShare * limits.jerk));
  return worst;
}

}  // namespace realtime
