#pragma once

#include "realtime/robot_controllers/torque.hpp"

namespace realtime::robot_controllers {

// Torques together with one of the four motion interfaces: the robot has the reference, and our controller follows it.
template <class Interface>
class TorqueBesideMotion : public Interface {
 public:
  bool takes_torque() const noexcept override { return true; }
  bool may_finish(const Cycle& cycle) const noexcept override { return Torque().may_finish(cycle); }
  void write(const Reference& before, const Reference& reference, const Vector7& tau_J_d,
             fci::RobotCommand& command) const noexcept override {
    Interface::write(before, reference, tau_J_d, command);
    Torque().write(before, reference, tau_J_d, command);
  }
};

}  // namespace realtime::robot_controllers
