#include "realtime/torque_gate.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/felt_inertia.hpp"
#include "realtime/tick.hpp"

namespace realtime {
namespace {

constexpr double kFloatRounding = 1e-5;  // of a state in protocol version 10

constexpr double kHeldFrom = 0.05, kHeldAt = 0.1;  // rad away, between which the bound comes in
constexpr double kLetGo = 0.15;                    // rad/s to which the torque may bring a joint that is let go

}  // namespace

// Share of the torque that is left, so that an arm which is held is not pulled too hard.
double TorqueGate::hold_back(const Matrix7& mobility, const Vector7& pull, double away) const noexcept {
  if (away < kHeldFrom) return 1;
  const Vector7 inertia = mobility.diagonal().cwiseInverse();
  const Vector7 bound = (2 * kLetGo * limits_.rate().cwiseProduct(inertia)).cwiseSqrt();
  const double most = pull.cwiseAbs().cwiseQuotient(bound).maxCoeff();
  const double in = std::min((away - kHeldFrom) / (kHeldAt - kHeldFrom), 1.);
  return most > 1 ? 1 - in + in / most : 1;
}

HeldBy TorqueGate::pass(const Cycle& cycle, WallGuard& walls, const Vector7& wanted, double away,
                        Vector7& tau_J_d) noexcept {
  const Vector7 sent = tau_J_d;
  Vector7 tau;
  const Matrix7 mobility = joint_mobility(cycle.model.mass());
  const Vector7& c = cycle.model.coriolis();
  const double share = wanted.allFinite() ? hold_back(mobility, wanted - c, away) : 1;
  const bool held_back = share < 1;
  bool limited = limits_.scale(held_back ? Vector7(c + share * (wanted - c)) : wanted, sent, kTick, tau);
  HeldBy held = when(held_back, HeldBy::kArm);
  held |= when(walls.active() && walls.add(cycle.q, cycle.dq, mobility, c, tau), HeldBy::kWall);
  held |= when(barrier_.add(cycle.q, cycle.dq, mobility, c, {cycle.dq_ref, away}, tau), HeldBy::kJointLimits);
  // The robot compares with the command before, however long ago that was; or, where one was lost, with the last that came.
  limited |= limits_.limit(tau, sent, kTick, tau_J_d);
  const Vector7 came = Vector7::Map(cycle.state.tau_J_d.data());
  if (cycle.state.control_command_success_rate < 1 && !came.isApprox(sent, kFloatRounding)) {
    limited |= limits_.limit(tau_J_d, came, kTick, tau_J_d);
  }
  return held | when(limited, HeldBy::kTorqueLimits);
}

}  // namespace realtime
