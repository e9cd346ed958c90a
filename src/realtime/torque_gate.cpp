#include "realtime/torque_gate.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "models/joint_figures.hpp"
#include "realtime/base_gravity.hpp"
#include "realtime/falling_torque.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/power_taken.hpp"
#include "realtime/tick.hpp"

namespace realtime {
namespace {

constexpr double kFloatRounding = 1e-5;  // of a state in protocol version 10

constexpr double kHeldFrom = 0.05, kHeldAt = 0.1;  // rad away, between which the bound comes in
constexpr double kLetGo = 0.15;                    // rad/s to which the torque may bring a joint that is let go

constexpr double kPowerShare = 0.9;   // of the bound, that a torque keeps to
constexpr double kToolShare = 0.9;    // likewise of the tool's speed
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

TorqueGate::TorqueGate(const models::Limits& limits)
    : bounds_(limits), robots_tool_speed_(limits.translation.velocity), limits_(limits), asked_(limits), barrier_(limits) {
  keep_to(bounds_);
}

void TorqueGate::keep_to(const Bounds& bounds) noexcept {
  bounds_ = bounds;
  bounds_.tool_speed = std::min(kToolShare * bounds.tool_speed, robots_tool_speed_);
  bounds_.power *= kPowerShare;
  asked_ = TorqueLimiter(bounds.limits);
  barrier_.reduce(bounds.limits);
}

// Of a tool that is to be braked, at an acceleration that keeps to its speed: a control barrier, as JointBarrier.
std::optional<JointBarrier::Brake> TorqueGate::tool_brake(const Cycle& cycle, const Vector7& pushed,
                                                          double approach) const noexcept {
  const auto J = cycle.model.jacobian().topRows<3>();
  const Vector3 v = J * cycle.dq;
  const double speed = v.norm(), room = bounds_.tool_speed - speed;
  if (!(speed > kFarFrom * bounds_.tool_speed)) return std::nullopt;
  const Vector3 along = v / speed;
  const Vector7 gradient = J.transpose() * along;
  const double faster = room > 0 ? approach * room : std::max(kApproach * room, -kToolBrake);
  return JointBarrier::Brake{gradient, faster - along.dot(cycle.model.dJ_dq().head<3>()) - std::max(gradient.dot(pushed), 0.)};
}

// To which a torque beside that at rest leads while it falls, rad/s.
Vector7 TorqueGate::velocity_to_come(const Vector7& dq, const Matrix7& mobility, const Vector7& tau) const noexcept {
  return dq + tau.cwiseAbs().cwiseQuotient(limits_.rate()).maxCoeff() / 2 * (mobility * tau);
}

HeldBy TorqueGate::pass(const Cycle& cycle, WallGuard& walls, const Vector7& wanted, double away, Vector7& tau_J_d,
                        bool loops_own) noexcept {
  const Vector7 sent = tau_J_d;
  Vector7 tau;
  const Matrix7 mobility = joint_mobility(cycle.model.mass());
  const Vector7& c = cycle.model.coriolis();
  const Vector7 gravity = cycle.model.gravity(base_gravity(cycle.state));
  limits_.beside(gravity);
  // The robot's estimate is of what the arm exerts.
  const Vector7 felt = Vector7::Map(cycle.state.tau_ext_hat_filtered.data());
  const Vector7 pushed = felt.allFinite() ? Vector7(mobility * -felt) : Vector7::Zero();
  double share = wanted.allFinite() ? hold_back(mobility, wanted - c, away) : 1;
  HeldBy held = when(share < 1, HeldBy::kArm);
  if (const double power = share * (wanted - c).dot(cycle.dq); !loops_own && power > bounds_.power) {
    share *= bounds_.power / power;
    held |= HeldBy::kPower;
  }
  // What is taken is convex in the share of the torque: it is less than in proportion.
  constexpr double kMostTaken = kPowerShare * models::kMostPower;
  if (const double taken = power_taken(c + share * (wanted - c) + gravity, cycle.dq); taken > kMostTaken) {
    const double anyhow = power_taken(c + gravity, cycle.dq);
    share *= anyhow < kMostTaken ? (kMostTaken - anyhow) / (taken - anyhow) : 0;
    held |= HeldBy::kPower;
  }
  bool limited = (loops_own ? limits_ : asked_).scale(share < 1 ? Vector7(c + share * (wanted - c)) : wanted, sent, kTick, tau);
  const bool has_walls = walls.arm() != nullptr;
  if (has_walls) walls.look(cycle.q, cycle.dq, velocity_to_come(cycle.dq, mobility, sent - c));
  const HeldBy pushed_away = has_walls ? walls.add(cycle.dq, mobility, c, tau) : HeldBy::kNothing;
  held |= pushed_away;
  const JointBarrier::Lead lead{cycle.dq_ref, away, pushed};
  auto tool = tool_brake(cycle, pushed, kApproach);
  held |= when(barrier_.add(cycle.q, cycle.dq, mobility, c, lead, tau, tool ? &*tool : nullptr), HeldBy::kJointLimits);
  held |= when(tool && tool->force > 0, HeldBy::kToolSpeed);
  // The robot compares with the command before, however long ago that was; or, where one was lost, with the last that came.
  limited |= limits_.limit(tau, sent, kTick, tau_J_d);
  const FallingTorque falling(cycle.model, cycle.dq, mobility, c, gravity, limits_.rate(), sent, walls);
  const SpeedBounds speeds{barrier_.dq_min(), barrier_.dq_max(), bounds_.tool_speed, bounds_.power, kMostTaken};
  if (!falling.keeps(speeds, tau_J_d)) {
    Vector7 slower = c * std::min(1., bounds_.power / std::max(c.dot(cycle.dq), 1e-9));
    const bool to_walls = has_walls && walls.brake_too_fast(falling.dq(), mobility, limits_.rate(), tau_J_d - c);
    if (to_walls || pushed_away != HeldBy::kNothing) held |= walls.add(cycle.dq, mobility, c, slower);
    tool = tool_brake(cycle, pushed, 0);
    barrier_.add(cycle.q, cycle.dq, mobility, c, lead, slower, tool ? &*tool : nullptr);
    falling.hold(speeds, c + limits_.share_inside(c, slower) * (slower - c), tau_J_d);
    limited = true;
  }
  const Vector7 came = Vector7::Map(cycle.state.tau_J_d.data());
  if (cycle.state.control_command_success_rate < 1 && !came.isApprox(sent, kFloatRounding)) {
    limited |= limits_.limit(tau_J_d, came, kTick, tau_J_d);
  }
  return held | when(limited, HeldBy::kTorqueLimits);
}

}  // namespace realtime
