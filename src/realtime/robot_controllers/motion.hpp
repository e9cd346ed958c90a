#pragma once

#include "realtime/robot_controllers/robot_controller.hpp"

namespace realtime::robot_controllers {

// By how much a state of float32 may be beside what was commanded, rad, m and rad/s: of numbers up to 4, with the robot's arithmetic.
constexpr double kFloatRounding = 3e-7;

// What the four motion interfaces have in common: the robot has the reference, at 1 kHz. It goes on with constant acceleration
// while it gets none.
class Motion : public RobotController {
 public:
  bool takes_torque() const noexcept override { return false; }
  bool has_reference() const noexcept override { return true; }
  int pass(int ticks, Limiter& limiter, Reference& reference) const noexcept override;
  bool reconcile(const fci::RobotState& state, fci::Version version, int ticks, Limiter& limiter, Reference& reference) const noexcept override;
  bool may_finish(const Cycle&) const noexcept override { return true; }
};

}  // namespace realtime::robot_controllers
