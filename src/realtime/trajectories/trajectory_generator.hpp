#pragma once

#include "realtime/part.hpp"
#include "realtime/reference.hpp"

namespace realtime {

// Emits the reference of a skill, cycle by cycle. A kind is one file of this folder: constructed in
// the server room from its message of wire/proto/trajectories.proto, where it may throw; the rest runs
// in the loop.
class TrajectoryGenerator : public Part {
 public:
  virtual ReferenceKind reference_kind() const noexcept = 0;
  virtual Effort effort() const noexcept { return Effort::kNone; }

  // Begins at `from`, with its velocity and acceleration. A motion too fast for the limits of the arm
  // is stretched here.
  virtual void start(const Reference& from) noexcept = 0;

  // Writes the reference `time` seconds after start(); any times may be asked for. True when the
  // trajectory is over: from then on the reference is the goal, at rest.
  virtual bool step(double time, Reference& reference) noexcept = 0;

  // Where it ends, known from start() on.
  virtual const Reference& goal() const noexcept = 0;

  // True when what was asked for lies beyond the arm's range and goal() falls short of it; known from
  // start() on.
  virtual bool shortened() const noexcept { return false; }

  // Duration after stretching, s, and by what factor (>= 1) it was stretched; known from start() on.
  virtual double duration() const noexcept = 0;
  virtual double stretch() const noexcept = 0;
};

}  // namespace realtime
