#pragma once

#include "realtime/check.hpp"
#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when a message over a topic says so. None of them is missed, however many come in a cycle.
class SensorSays : public Termination {
 public:
  // Throws std::invalid_argument.
  explicit SensorSays(const std::string& topic)
      : input_(std::make_shared<SensorInput>(require_topic(topic),
                                             std::vector<std::string>{"ShouldTerminateSensorMessage"}, 0, nullptr, says)) {}

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return {input_}; }
  bool step(const Cycle&, const Progress&) noexcept override {
    SensorSample sample;
    said_ |= input_->newest(sample);
    return said_;
  }

 private:
  // Only those get here, so that no number of others fills the way.
  static bool says(const SensorSample& sample) {
    constexpr int kSaysAt = 1;  // in the message's numbers
    return sample.values[kSaysAt] != 0;
  }

  std::shared_ptr<SensorInput> input_;
  bool said_ = false;
};

}  // namespace realtime
