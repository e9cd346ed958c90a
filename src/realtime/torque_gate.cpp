#include "realtime/torque_gate.hpp"

namespace realtime {
namespace {

constexpr double kTick = 0.001;          // s, a cycle of the robot
constexpr double kFloatRounding = 1e-5;  // of a state in protocol version 10

}  // namespace

bool TorqueGate::pass(const Cycle& cycle, WallGuard& walls, const Vector7& wanted, bool tracks,
                      Vector7& tau_J_d) noexcept {
  const Vector7 sent = tau_J_d;
  Vector7 tau;
  bool held = limits_.scale(wanted, sent, kTick, tau);
  walled_ = walls.active() && walls.add(cycle.q, cycle.dq, cycle.model.mass(), cycle.model.coriolis(), tau);
  held |= walled_;
  const JointBarrier::Lead lead{cycle.q_ref, cycle.dq_ref};
  held |= barrier_.add(cycle.q, cycle.dq, cycle.model.mass(), cycle.model.coriolis(), tracks ? &lead : nullptr, tau);
  // The robot compares with the command before, however long ago that was; or, where one was lost, with the last that came.
  held |= limits_.limit(tau, sent, kTick, tau_J_d);
  const Vector7 came = Vector7::Map(cycle.state.tau_J_d.data());
  if (cycle.state.control_command_success_rate < 1 && !came.isApprox(sent, kFloatRounding)) {
    held |= limits_.limit(tau_J_d, came, kTick, tau_J_d);
  }
  return held;
}

}  // namespace realtime
