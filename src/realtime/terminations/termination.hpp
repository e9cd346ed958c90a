#pragma once

#include "realtime/cycle.hpp"
#include "realtime/part.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// What a termination may look at, beside the cycle.
struct Progress {
  const TrajectoryGenerator& trajectory;
  bool trajectory_over = false;
  const Reference& reference;  // commanded in this cycle, after the limits
  bool waits = false;          // its trajectory has waited for an arm that was held
  double planned = 0;          // s of the skill after which it should be over
};

// Says when a skill ends. A kind is one file of this folder: constructed in the server room from its
// message of wire/proto/terminations.proto, where it may throw; step() runs in the loop.
class Termination : public Part {
 public:
  // The channels that a trajectory must fill for it.
  virtual Channels judges() const noexcept { return Channels::kNone; }

  virtual void start() noexcept {}
  virtual bool step(const Cycle& cycle, const Progress& progress) noexcept = 0;
};

}  // namespace realtime
