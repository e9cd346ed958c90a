#pragma once

#include "realtime/check.hpp"
#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when nothing has come over a topic for a time: since the start, or since the last message.
class Silence : public Termination {
 public:
  // Seconds: 0.001 to 3600. Throws std::invalid_argument.
  Silence(const std::string& topic, double seconds)
      : input_(std::make_shared<SensorInput>(require_topic(topic), std::vector<std::string>{})), seconds_(seconds) {
    require_within("seconds", -1, seconds, 0.001, 3600, "s");
  }

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return {input_}; }
  void start() noexcept override { begun_ = false; }
  bool step(const Cycle& cycle, const Progress&) noexcept override {
    SensorSample sample;
    if (input_->newest(sample) || !begun_) heard_ = cycle.time;
    begun_ = true;
    return cycle.time - heard_ >= seconds_;
  }

 private:
  std::shared_ptr<SensorInput> input_;
  double seconds_;
  bool begun_ = false;
  double heard_ = 0;  // s
};

}  // namespace realtime
