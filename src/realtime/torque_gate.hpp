#pragma once

#include "models/arm.hpp"
#include "realtime/bounds.hpp"
#include "realtime/cycle.hpp"
#include "realtime/held_by.hpp"
#include "realtime/joint_barrier.hpp"
#include "realtime/limiter.hpp"
#include "realtime/walls/wall_guard.hpp"

namespace realtime {

// Where every torque goes through before it is sent. What a controller asks for is scaled as a whole where it is beyond the
// limits, so that the wrench that it makes keeps its direction; then walls and joint limits push and brake the measured arm; and
// what they add stays inside the limits too. An arm that something holds away from its reference is pulled no harder than lets
// it be slow when it is let go: with inertia I and torque falling at its rate r it comes to tau²/(2 r I).
// A controller's torque is also kept to the bounds of what may be asked for, and a tool that is faster than these is braked.
class TorqueGate {
 public:
  explicit TorqueGate(const models::Limits& limits) : bounds_(limits), limits_(limits), asked_(limits), barrier_(limits) {}

  // From now on.
  void keep_to(const Bounds& bounds) noexcept;

  // The greatest of these torques, by what that joint can give.
  double share(const Vector7& tau) const noexcept { return limits_.share(tau); }

  // tau_J_d: the last command in, the next one out (N m); returns what held it back.
  // `away`: from where the controller leads it, rad (MotionGate::away()); 0 if it leads it nowhere.
  HeldBy pass(const Cycle& cycle, WallGuard& walls, const Vector7& wanted, double away, Vector7& tau_J_d) noexcept;

 private:
  double hold_back(const Matrix7& mobility, const Vector7& pull, double away) const noexcept;

  bool brake_tool(const Cycle& cycle, const Matrix7& mobility, Vector7& tau) const noexcept;

  Bounds bounds_;
  TorqueLimiter limits_, asked_;  // of the arm, and of what a controller may ask for
  JointBarrier barrier_;
};

}  // namespace realtime
