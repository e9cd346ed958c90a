#pragma once

#include "realtime/cycle.hpp"
#include "realtime/part.hpp"
#include "realtime/soft_ending.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

class PartWatch;

// What a termination may look at, beside the cycle.
struct Progress {
  const TrajectoryGenerator& trajectory;
  bool trajectory_over = false;
  const Reference& reference;  // commanded in this cycle, after the limits
  bool waits = false;          // its trajectory has waited for an arm that was held
  double planned = 0;          // s of the skill after which it should be over
  double began = 0;            // s of the skill, at which the trajectory did, or another in its place
  // What the arm exerts on what it touches, by the momentum observer; N m; N and N m at K, axes of O.
  Vector7 tau_ext = Vector7::Zero();
  Vector6 O_F_ext_K = Vector6::Zero();
};

// Says when a skill ends. A kind is one file of this folder: constructed in the server room from its
// message of wire/proto/terminations.proto, where it may throw; step() runs in the loop.
class Termination : public Part {
 public:
  // The channels that a trajectory must fill for it.
  virtual Channels judges() const noexcept { return Channels::kNone; }

  // Whether it looks for the trajectory's goal alone, which is never met where limits or walls are in the way of it.
  virtual bool seeks_goal() const noexcept { return false; }

  // What the arm does where this has ended the skill. One that has such an ending looks at what is measured alone, and is asked
  // before anything is commanded in the cycle; null: it is asked afterwards, and the reference is braked to rest.
  virtual SoftEnding* then() noexcept { return nullptr; }

  // For those that consist of others: by what each of these is watched; before start(). It outlives them.
  virtual void watched_by(PartWatch&) noexcept {}

  virtual void start() noexcept {}
  virtual bool step(const Cycle& cycle, const Progress& progress) noexcept = 0;
};

}  // namespace realtime
