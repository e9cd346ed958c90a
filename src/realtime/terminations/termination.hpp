#pragma once

#include "realtime/cycle.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// What a termination may look at, beside the cycle.
struct Progress {
  const TrajectoryGenerator& trajectory;
  bool trajectory_over = false;
  const Reference& reference;  // commanded in this cycle, after the limits
};

// Says when a skill ends. A kind is one file of this folder: constructed in the server room from its
// message of wire/proto/terminations.proto, where it may throw; step() runs in the loop.
class Termination {
 public:
  virtual ~Termination() = default;

  // Whether it can judge a trajectory of such references.
  virtual bool accepts(ReferenceKind) const noexcept { return true; }
  virtual void start() noexcept {}
  virtual bool step(const Cycle& cycle, const Progress& progress) noexcept = 0;
};

}  // namespace realtime
