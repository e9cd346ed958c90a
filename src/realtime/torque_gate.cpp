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

constexpr double kPowerShare = 0.95;  // of the bound, that a torque keeps to
constexpr double kToolShare = 0.96;   // likewise of the tool's speed
constexpr double kApproach = 25;      // 1/s, at which the tool may come near to that, and falls back to it
constexpr double kFarFrom = 0.4;      // of it: below nothing is looked at
constexpr double kToolBrake = 4;      // m/s², at most, of a tool that has just become too fast as less is allowed

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

void TorqueGate::keep_to(const Bounds& bounds) noexcept {
  bounds_ = bounds;
  asked_ = TorqueLimiter(bounds.limits);
  barrier_.reduce(bounds.limits);
}

// By a force against its motion, where the torque would make it faster than may be: a control barrier, as JointBarrier.
bool TorqueGate::brake_tool(const Cycle& cycle, const Matrix7& mobility, Vector7& tau) const noexcept {
  const Vector3 v = cycle.model.jacobian().topRows<3>() * cycle.dq;
  const double speed = v.norm(), fastest = kToolShare * bounds_.tool_speed;
  if (!(speed > kFarFrom * fastest)) return false;
  const Vector3 along = v / speed;
  const Vector7 gradient = cycle.model.jacobian().topRows<3>().transpose() * along;
  const double faster = gradient.dot(mobility * (tau - cycle.model.coriolis())) + along.dot(cycle.model.dJ_dq().head<3>());
  const double force = (faster - std::max(kApproach * (fastest - speed), -kToolBrake)) / gradient.dot(mobility * gradient);
  if (!(force > 0)) return false;
  tau -= force * gradient;
  return true;
}

HeldBy TorqueGate::pass(const Cycle& cycle, WallGuard& walls, const Vector7& wanted, double away,
                        Vector7& tau_J_d) noexcept {
  const Vector7 sent = tau_J_d;
  Vector7 tau;
  const Matrix7 mobility = joint_mobility(cycle.model.mass());
  const Vector7& c = cycle.model.coriolis();
  double share = wanted.allFinite() ? hold_back(mobility, wanted - c, away) : 1;
  HeldBy held = when(share < 1, HeldBy::kArm);
  if (const double power = share * (wanted - c).dot(cycle.dq), most = kPowerShare * bounds_.power; power > most) {
    share *= most / power;
    held |= HeldBy::kPower;
  }
  bool limited = asked_.scale(share < 1 ? Vector7(c + share * (wanted - c)) : wanted, sent, kTick, tau);
  held |= when(brake_tool(cycle, mobility, tau), HeldBy::kToolSpeed);
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
