#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "realtime/check.hpp"
#include "realtime/reference.hpp"
#include "realtime/sensor_input.hpp"

namespace realtime {

// N gains of a controller, which a sensor message may set anew while it runs: each goes from where it is to what was sent last
// in a straight line, for 0.1 s, so that no torque jumps. What a message leaves out (NaN) stays as it is.
template <int N>
class GainStream {
 public:
  using Gains = Eigen::Matrix<double, N, 1>;
  // Throws std::invalid_argument naming field, value and bound. Called in the server room.
  using Check = std::function<void(const Gains&)>;

  // In a message the gains are the numbers from `first` on; those that it leaves out are checked as they were sent last.
  // Without a topic they stay. `timeout`: as of SensorInput. Throws std::invalid_argument.
  GainStream(const Gains& gains, const std::optional<std::string>& topic, const std::string& message, std::size_t first,
             const Check& check, double timeout = 0)
      : gains_(gains), goal_(gains), first_(first) {
    check(gains);
    if (!topic) return;
    auto refusal = [last = gains, first, check](const SensorSample& sample) mutable -> std::string {
      const auto sent = Gains::Map(sample.values.data() + first);
      const Gains all = sent.array().isNaN().select(last, sent);
      try {
        check(all);
      } catch (const std::invalid_argument& error) {
        return error.what();
      }
      last = all;
      return "";
    };
    input_ = std::make_shared<SensorInput>(require_topic(*topic), std::vector<std::string>{message}, timeout, refusal);
  }

  bool changes() const noexcept { return input_ != nullptr; }
  std::vector<std::shared_ptr<SensorInput>> inputs() const {
    return input_ ? std::vector{input_} : std::vector<std::shared_ptr<SensorInput>>{};
  }

  // Once in a cycle, `dt` s after the one before.
  void step(double dt) noexcept {
    if (!input_) return;
    silent_ += dt;
    for (SensorSample sample; input_->take(sample);) {
      const auto sent = Gains::Map(sample.values.data() + first_);
      goal_ = sent.array().isNaN().select(goal_, sent);
      left_ = kWay;
      silent_ = 0;
    }
    if (left_ < dt + kRounding) {
      gains_ = goal_;
    } else {
      gains_ += dt / left_ * (goal_ - gains_);
      left_ -= dt;
    }
  }

  // As they are, and as they will be.
  const Gains& now() const noexcept { return gains_; }
  const Gains& goal() const noexcept { return goal_; }
  // Since the last message, s.
  double silent() const noexcept { return silent_; }

 private:
  static constexpr double kWay = 0.1, kRounding = 1e-9;  // s

  Gains gains_, goal_;
  std::size_t first_;
  double left_ = 0, silent_ = 0;  // s
  std::shared_ptr<SensorInput> input_;
};

}  // namespace realtime
