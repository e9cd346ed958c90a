#pragma once

#include "realtime/cycle.hpp"
#include "realtime/limiter.hpp"
#include "realtime/tick.hpp"
#include "robot/mode.hpp"
#include "wire/fci/layout.hpp"
#include "wire/fci/robot_command.hpp"

namespace realtime {

// What one of libfranka's nine robot controllers makes of the loop: where a motion begins, what the robot does while nothing
// comes, when it may be finished, and the bytes. A kind is one file of this folder; nothing else asks for the mode.
class RobotController {
 public:
  // Cycles in a row without a command, after which the robot ends a motion.
  static constexpr int kMostLost = 20;

  virtual ~RobotController() = default;

  // The robot takes torques of ours; else its own controllers follow what is commanded.
  virtual bool takes_torque() const noexcept = 0;
  // The robot has a reference of its own, which it moves on by itself where commands are lost: it cannot be moved to where a
  // controller would like it.
  virtual bool has_reference() const noexcept = 0;
  // That reference is a pose, and the robot makes joints of it (`q_d`).
  virtual bool makes_joints() const noexcept { return false; }

  // The reference that a motion begins from, at rest.
  virtual Reference start(const Cycle& cycle, Channels motion, Model& model) const noexcept = 0;

  // States were lost, `ticks` cycles (1: none; at most kMostLost more) went by since the last: moves `reference` to where the robot has it, and returns
  // how many steps of a trajectory this cycle is worth.
  virtual int pass(int ticks, Limiter& limiter, Reference& reference) const noexcept = 0;

  // Commands before those `ticks` did not come to the robot: then moves `reference` to where the robot had it one cycle after the
  // last command, from where pass() goes on.
  virtual bool reconcile(const fci::RobotState& state, fci::Version version, int ticks, Limiter& limiter,
                         Reference& reference) const noexcept = 0;

  // The finish flag would find the arm at rest, once the reference is: finishing while it moves is a reflex.
  virtual bool may_finish(const Cycle& cycle) const noexcept = 0;

  // The command of a cycle; `before` is the reference one cycle before.
  virtual void write(const Reference& before, const Reference& reference, const Vector7& tau_J_d,
                     fci::RobotCommand& command) const noexcept = 0;
};

// The one that a mode names; lives as long as the program.
const RobotController& robot_controller(const robot::Mode& mode) noexcept;

}  // namespace realtime
