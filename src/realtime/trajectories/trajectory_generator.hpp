#pragma once

#include <cmath>

#include "realtime/cycle.hpp"
#include "realtime/part.hpp"
#include "realtime/reference.hpp"

namespace realtime {

// Emits the reference of a skill, cycle by cycle. A kind is one file of this folder: constructed in
// the server room from its message of wire/proto/trajectories.proto, where it may throw; the rest runs
// in the loop.
class TrajectoryGenerator : public Part {
 public:
  // What its references say: one motion, and what it asks for beside that.
  virtual Channels fills() const noexcept = 0;

  // Begins at `from`, with its velocity and acceleration. A motion too fast for the limits of the arm
  // is stretched here.
  virtual void start(const Reference& from) noexcept = 0;

  // Writes the reference `time` s after start(), along the trajectory: its time goes slower than the robot's clock where the
  // skill's speed or limits of the arm ask for it. Any times may be asked for; the server room asks in advance, with what is
  // measured then and a model in no particular posture. True when the trajectory is over: from then on the reference is the goal,
  // at rest.
  virtual bool step(const Cycle& cycle, double time, Reference& reference) noexcept = 0;

  // Where it ends, known from start() on.
  virtual const Reference& goal() const noexcept = 0;

  // True when what was asked for lies beyond the arm's range and goal() falls short of it; known from
  // start() on.
  virtual bool shortened() const noexcept { return false; }

  // Limits, walls or an arm that is held were in the way of the last step: the reference is here. What sums up velocities goes on from
  // about there, or it would have to come back first.
  virtual void held_back(const Reference&) noexcept {}

  // Whether what comes while it runs asked for more in the last step than limits allow.
  virtual bool limited() const noexcept { return false; }

  // Duration after stretching, s, and by what factor (>= 1) it was stretched; known from start() on.
  virtual double duration() const noexcept = 0;
  virtual double stretch() const noexcept = 0;

  // What comes as it goes along, as a stream, has none.
  bool has_end() const noexcept {
    const double end = duration();
    return end > 0 && std::isfinite(end);
  }
};

}  // namespace realtime
