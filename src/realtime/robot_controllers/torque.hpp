#pragma once

#include <algorithm>

#include "realtime/robot_controllers/robot_controller.hpp"

namespace realtime::robot_controllers {

// Torques alone: the reference is ours, and begins where the arm is measured.
class Torque : public RobotController {
 public:
  static constexpr double kSlow = 0.01;  // rad/s
  static constexpr int kMostSteps = 5;   // of a trajectory in one cycle: its budget bounds how fast lost time is made up for

  bool takes_torque() const noexcept override { return true; }
  bool has_reference() const noexcept override { return false; }
  Reference start(const Cycle& cycle, Channels motion, Model& model) const noexcept override;
  // What only a controller of ours follows has gone where the trajectory led it.
  int pass(int ticks, Limiter&, Reference&) const noexcept override { return std::min(ticks, kMostSteps); }
  bool reconcile(const fci::RobotState&, fci::Version, int, Limiter&, Reference&) const noexcept override { return false; }
  bool may_finish(const Cycle& cycle) const noexcept override { return cycle.dq.cwiseAbs().maxCoeff() < kSlow; }
  void write(const Reference&, const Reference&, const Vector7& tau_J_d, fci::RobotCommand& command) const noexcept override {
    Vector7::Map(command.tau_J_d.data()) = tau_J_d;
  }
};

}  // namespace realtime::robot_controllers
