#pragma once

#include <optional>

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
// A controller's torque is also kept to the bounds of what may be asked for, and a tool that is faster than these, or than the
// robot allows, is braked. All of it can be taken back, as fast as the robot lets torque fall, before joints or tool are too fast
// or do too much work (FallingTorque).
class TorqueGate {
 public:
  explicit TorqueGate(const models::Limits& limits);

  // From now on.
  void keep_to(const Bounds& bounds) noexcept;

  // The greatest of these torques, by what that joint can give.
  double share(const Vector7& tau) const noexcept { return limits_.share(tau); }

  // tau_J_d: the last command in, the next one out (N m); returns what held it back.
  // `away`: from where the controller leads it, rad (Loop::away()); 0 if it leads it nowhere.
  // `loops_own`: no controller's, but what brakes and holds an arm that has none: bounds of what may be asked for do not weaken it.
  HeldBy pass(const Cycle& cycle, WallGuard& walls, const Vector7& wanted, double away, Vector7& tau_J_d,
              bool loops_own = false) noexcept;

 private:
  double hold_back(const Matrix7& mobility, const Vector7& pull, double away) const noexcept;

  // `pushed`: JointBarrier::Lead; `approach`: 1/s, at which the tool may come near to its greatest speed.
  Vector7 velocity_to_come(const Vector7& dq, const Matrix7& mobility, const Vector7& tau) const noexcept;
  std::optional<JointBarrier::Brake> tool_brake(const Cycle& cycle, const Vector7& pushed, double approach) const noexcept;

  Bounds bounds_;                 // with room for what is not foreseen
  double robots_tool_speed_;      // m/s, that it allows
  TorqueLimiter limits_, asked_;  // of the arm, and of what a controller may ask for
  JointBarrier barrier_;
};

}  // namespace realtime
