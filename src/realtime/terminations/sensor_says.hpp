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
                                             std::vector<std::string>{"ShouldTerminateSensorMessage"})) {}

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return {input_}; }
  bool step(const Cycle&, const Progress&) noexcept override {
    constexpr int kSaysAt = 1;  // in the message's numbers
    while (const SensorSample* sample = input_->next()) {
      said_ = said_ || sample->values[kSaysAt] != 0;
      input_->release();
    }
    return said_;
  }

 private:
  std::shared_ptr<SensorInput> input_;
  bool said_ = false;
};

}  // namespace realtime
