#pragma once

#include <optional>

#include "realtime/cycle.hpp"
#include "realtime/part.hpp"
#include "robot/mode.hpp"

namespace realtime {

// Turns references into torques, or hands them on to the robot's own controllers. A kind is one file
// of this folder: constructed in the server room from its message of wire/proto/controllers.proto,
// where it may throw; the rest runs in the loop.
class Controller : public Part {
 public:
  // The channels that it can make something of. It is for trajectories that fill none but these.
  virtual Channels takes() const noexcept = 0;

  // Whether it leads the arm to the reference. One that does not is for torque alone; it never holds an arm, and what comes
  // after begins from where the arm is.
  virtual bool tracks() const noexcept { return true; }

  // Whether it leads all of the arm there, and no force moves some of it elsewhere on purpose.
  virtual bool leads() const noexcept { return tracks(); }

  // Of a way from the arm to a reference what it leads the arm along: all but where it has no spring. Of joints, rad, or of a pose,
  // m and rad along the axes of O.
  virtual Vector7 led_joints(const Vector7& way) const noexcept { return way; }
  virtual Vector6 led_pose(const Cycle&, const Vector6& way) const noexcept { return way; }

  // The robot controller that runs it for such a motion, and what the robot must be set to.
  virtual robot::Mode mode(Channels motion) const noexcept = 0;
  virtual robot::Settings settings() const noexcept { return {}; }

  // Joints, rad, that those of the reference (Cycle::q_ref) are led near while its skill runs and a pose leaves the elbow free;
  // none: it stays where it is. For laws that hold the null space to them, where the robot does not make joints of the pose.
  virtual std::optional<Vector7> posture() const noexcept { return {}; }

  // Takes over. When the law before it asked for cycle.tau_J_d, a law with a spring moves `reference` so that it asks for
  // the same torque from there (torque control only; velocity and acceleration stay). A difference that is left fades away.
  virtual void start(const Cycle& cycle, Reference& reference) noexcept = 0;

  // The arm has touched something, and the reference now rests where it is: what a law has summed up on the way there would go on
  // pressing.
  virtual void stay() noexcept {}

  // Torque for this cycle, N m, without gravity, which the robot compensates. Not called where the robot's own controller
  // tracks the reference; after start() called twice in that cycle.
  virtual void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept = 0;
};

}  // namespace realtime
