#include "realtime/torque_gate.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/cholesky.hpp"

namespace realtime {
namespace {

constexpr double kTick = 0.001;          // s, a cycle of the robot
constexpr double kFloatRounding = 1e-5;  // of a state in protocol version 10

constexpr double kHeldFrom = 0.05, kHeldAt = 0.1;  // rad away from the reference, between which the bound comes in
constexpr double kLetGo = 0.15;                    // rad/s to which the torque may bring a joint that is let go
constexpr double kMotorInertia = 0.1;              // kg m², about what the mass matrix leaves out of each joint

}  // namespace

// Share of the torque that is left, so that no joint which is held is pulled too hard.
double TorqueGate::hold_back(const Cycle& cycle, const Vector7& tau) const noexcept {
  const Vector7 away = cycle.q_ref - cycle.q, pull = tau - cycle.model.coriolis();
  if (away.cwiseAbs().maxCoeff() < kHeldFrom) return 1;
  Matrix7 B = cycle.model.mass();
  B.diagonal().array() += kMotorInertia;
  const Vector7 inertia = Cholesky<models::kJoints>(B).inverse().diagonal().cwiseInverse();
  double share = 1;
  for (int i = 0; i < models::kJoints; ++i) {
    if (std::abs(away[i]) < kHeldFrom || away[i] * pull[i] <= 0) continue;
    const double bound = std::sqrt(2 * limits_.rate()[i] * inertia[i] * kLetGo);
    const double in = std::min((std::abs(away[i]) - kHeldFrom) / (kHeldAt - kHeldFrom), 1.);
    share = std::min(share, 1 - in + in * std::min(bound / std::abs(pull[i]), 1.));
  }
  return share;
}

bool TorqueGate::pass(const Cycle& cycle, WallGuard& walls, const Vector7& wanted, bool tracks,
                      Vector7& tau_J_d) noexcept {
  const Vector7 sent = tau_J_d;
  Vector7 tau;
  const double share = tracks && wanted.allFinite() ? hold_back(cycle, wanted) : 1;
  const Vector7& c = cycle.model.coriolis();
  const bool held_back = share < 1;
  bool held = limits_.scale(held_back ? Vector7(c + share * (wanted - c)) : wanted, sent, kTick, tau) || held_back;
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
