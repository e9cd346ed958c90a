#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "realtime/check.hpp"
#include "realtime/sensor_input.hpp"
#include "realtime/trajectories/dmp.hpp"

namespace realtime {

// The rollout of a movement primitive (dmp.hpp) whose sensors' values may come anew while it runs. With values v it is
// sum of v_s times the rollout of sensor s. As the springs are linear and their coefficients do not change, what they are away
// from the rollout of new values when these come, in position and velocity, fades as a motion without a force does:
//
//   y(t) = sum v_s y_s(t) + p(t - t0) dx + w(t - t0) dv,  dx = sum (v_s before - v_s) y_s(t0) + what was left at t0, dv likewise
//
// with p and w from one that begins at 1, or with velocity 1. So position and velocity go on and the acceleration jumps, which
// the limiter rounds.
template <int N>
class DmpSensors {
 public:
  using Vector = typename DmpRollout<N>::Vector;
  using Rates = typename DmpRollout<N>::Rates;

  // M dimensions from `first` on; `force(sensor)(t)` makes the N of a rollout. Throws std::invalid_argument as DmpRollout does.
  template <int M, class Force>
  DmpSensors(const std::string& prefix, const DmpSpring& spring, double duration, const DmpForcing<M>& forcing, int first,
             const std::optional<std::string>& topic, bool values_of_each_dimension, Force force)
      : first_(first), dimensions_(M), each_(values_of_each_dimension), initial_(Values::Zero(N, forcing.sensors())) {
    initial_.middleRows(first, M) = forcing.values();
    for (int s = 0; s < forcing.sensors(); ++s) rollouts_.emplace_back(prefix, spring, duration, force(s));
    values_ = sent_ = initial_;
    if (!topic) return;
    const int expected = each_ ? M * forcing.sensors() : forcing.sensors();
    input_ = std::make_shared<SensorInput>(
        require_topic(*topic), std::vector<std::string>{"DmpSensorValues"}, 0,
        [expected](const SensorSample& sample) -> std::string {
          int given = 0;
          for (const double value : sample.values) given += std::isnan(value) ? 0 : 1;
          if (given == expected) return "";
          return std::to_string(given) + " values: expected " + std::to_string(expected);
        });
  }

  std::vector<std::shared_ptr<SensorInput>> inputs() const {
    return input_ ? std::vector{input_} : std::vector<std::shared_ptr<SensorInput>>{};
  }

  // With the initial values, at time 0.
  void start() noexcept {
    values_ = initial_;
    changed_ = 0;
    away_.setZero();
    away_rate_.setZero();
  }

  // What has come, at t on the rollout's clock; whether anything has changed.
  bool take(double t) noexcept {
    SensorSample sample;
    if (!input_ || !input_->newest(sample)) return false;
    for (int i = 0; i < dimensions_; ++i) {
      for (int s = 0; s < sent_.cols(); ++s) {
        sent_(first_ + i, s) = sample.values[static_cast<std::size_t>(each_ ? i * sent_.cols() + s : s)];
      }
    }
    if (sent_ == values_) return false;
    const Rates before = at(t);
    values_.swap(sent_);
    away_.setZero();
    away_rate_.setZero();
    changed_ = t;
    const Rates after = at(t);
    away_ = before.x.forced - after.x.forced;
    away_rate_ = before.v.forced - after.v.forced;
    return true;
  }

  double duration() const { return rollouts_.front().duration(); }
  std::size_t steps() const { return rollouts_.front().steps(); }

  Rates at(double t) const {
    Rates all = rollouts_.front().at(t);
    all.x.forced.array() *= values_.col(0).array();
    all.v.forced.array() *= values_.col(0).array();
    all.a.forced.array() *= values_.col(0).array();
    for (int s = 1; s < values_.cols(); ++s) {
      const Rates one = rollouts_[static_cast<std::size_t>(s)].at(t);
      all.x.forced += values_.col(s).cwiseProduct(one.x.forced);
      all.v.forced += values_.col(s).cwiseProduct(one.v.forced);
      all.a.forced += values_.col(s).cwiseProduct(one.a.forced);
    }
    if (changed_ > 0) {
      const Rates fades = rollouts_.front().at(t - changed_);
      all.x.forced += fades.x.from_position * away_ + fades.x.from_velocity * away_rate_;
      all.v.forced += fades.v.from_position * away_ + fades.v.from_velocity * away_rate_;
      all.a.forced += fades.a.from_position * away_ + fades.a.from_velocity * away_rate_;
    }
    return all;
  }

 private:
  using Values = Eigen::Matrix<double, N, Eigen::Dynamic>;

  int first_, dimensions_;
  bool each_;
  std::vector<DmpRollout<N>> rollouts_;  // of each sensor
  Values initial_, values_, sent_;       // of each dimension and sensor
  std::shared_ptr<SensorInput> input_;
  double changed_ = 0;  // s
  Vector away_ = Vector::Zero(), away_rate_ = Vector::Zero();
};

}  // namespace realtime
