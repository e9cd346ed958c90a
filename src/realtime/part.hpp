#pragma once

#include <memory>
#include <vector>

#include "realtime/sensor_input.hpp"

namespace realtime {

// What a skill is composed of. Built in the server room, where it may throw; what begins with start or step runs in the loop.
class Part {
 public:
  virtual ~Part() = default;

  // Where it takes sensor messages from; asked for once, in the server room.
  virtual std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const { return {}; }
};

}  // namespace realtime
