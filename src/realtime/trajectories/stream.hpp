#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// What comes over a topic while the skill runs, made into a motion. It has no duration and ends by a termination only; its goal
// is where it began, at rest.
class Stream : public TrajectoryGenerator {
 public:
  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return {input_}; }
  void start(const Reference& from) noexcept override { began_ = at_rest(from); }
  const Reference& goal() const noexcept override { return began_; }
  double duration() const noexcept override { return 0; }
  double stretch() const noexcept override { return 1; }

 protected:
  explicit Stream(std::shared_ptr<SensorInput> input) : input_(std::move(input)) {}

  const std::shared_ptr<SensorInput> input_;

 private:
  Reference began_;
};

}  // namespace realtime
