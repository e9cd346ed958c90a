#pragma once

#include "realtime/cycle.hpp"
#include "robot/mode.hpp"

namespace realtime {

// Turns references into torques, or hands them on to the robot's own controllers. A kind is one file
// of this folder: constructed in the server room from its message of wire/proto/controllers.proto,
// where it may throw; the rest runs in the loop.
class Controller {
 public:
  virtual ~Controller() = default;

  virtual bool accepts(ReferenceKind kind) const noexcept = 0;

  // The robot controller that runs it for references of that kind, and what the robot must be set to.
  virtual robot::Mode mode(ReferenceKind kind) const noexcept = 0;
  virtual robot::Settings settings() const noexcept { return {}; }

  // Takes over. When the law before it asked for cycle.tau_J_d, `reference` is moved so that this law
  // asks for the same torque from it (torque control only; velocity and acceleration stay).
  virtual void start(const Cycle& cycle, Reference& reference) noexcept = 0;

  // Torque for this cycle, N m, without gravity, which the robot compensates. Not called where the
  // robot's own controller tracks the reference.
  virtual void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept = 0;
};

}  // namespace realtime
