#include "realtime/motion_gate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

#include "models/joint_figures.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/power_taken.hpp"
#include "realtime/rotation.hpp"

namespace realtime {
namespace {

constexpr double kBeside = 2e-3;  // rad, m

// Of the bounds, that a reference keeps to, as the arm is not quite where that is; and of the tool's speed where joints are slowed.
constexpr double kBoundShare = 0.96, kPowerShare = 0.9, kSlowShare = 0.9, kTorqueShare = 0.97;
constexpr double kSoon = 0.1;         // s in which a joint that moves along goes a way that counts like one that is left
constexpr double kNoWay = 1e-9;       // m, of the tool
constexpr double kSlowest = 1e-3;     // rad/s, of a joint that has no way to go
constexpr double kNoFaster = 1e-4;    // m/s in a cycle, of a tool that is being slowed

constexpr double kLeftBehind = 1e-3;        // m and rad, between a pose and its joints, that is no longer rounding
constexpr double kNearlySingular = 1.1e-3;  // determinant, a little before a pose that moves is stopped
constexpr double kLookAhead = 1e-3;         // rad, of all joints together

constexpr double kLeastSpared = 0.3;  // or the arm would not come to rest before anything

// So near to each other that an arm which a wall holds up does not stir for it.
bool beside(const Reference& a, const Reference& b) {
  if (a.motion == Channels::kJoint) return (a.joint.q - b.joint.q).norm() < kBeside;
  return (a.cartesian.position - b.cartesian.position).norm() < kBeside &&
         a.cartesian.orientation.angularDistance(b.cartesian.orientation) < kBeside;
}

}  // namespace

MotionGate::MotionGate(const models::Limits& limits, Model& model)
    : model_(model),
      bounds_(limits),
      robots_tool_speed_(limits.translation.velocity),
      ddq_max_(Vector7::Map(limits.ddq_max.data())),
      brake_jerk_(Limiter::kSoonJerk * Vector7::Map(limits.dddq_max.data())),
      tau_max_(Vector7::Map(limits.tau_max.data())),
      limiter_(limits),
      pose_joints_(model, limits) {
  keep_to(bounds_);
}

Walls* MotionGate::keep_from(Walls* walls) noexcept {
  self_ = {};  // what it holds may be another
  unseen_ = true;
  return walls_.change(walls);
}

void MotionGate::reset(const Reference& from) noexcept {
  before_ = from;
  met_ = HeldBy::kNothing;
  slowed_ = straight_ = false;
  if (limiter_.reset(from)) return;  // and comes to rest as before
  soon_ = unseen_ = false;
  spared_ = 1;
  limiter_.spare(1, 1);
}

void MotionGate::place(const Vector7& q) noexcept {
  joints_.q = q;
  pose_joints_.place(q);  // the tool may be another
}

void MotionGate::keep_to(const Bounds& bounds) noexcept {
  bounds_ = bounds;
  bounds_.tool_speed = std::min(bounds.tool_speed, robots_tool_speed_);
  limiter_.reduce(bounds.limits);
}

void MotionGate::observe(const Reference& reference, const Vector7& gravity, const Vector7* q_d) noexcept {
  gravity_ = gravity;
  if (reference.motion == Channels::kJoint) {
    joints_.q = reference.joint.q;
  } else if (q_d != nullptr) {
    joints_ = model_.joints_of_pose(*q_d, Model::kNoDamping);
  } else {
    if (pose_joints_.joints().q != joints_.q) pose_joints_.place(joints_.q);
    pose_joints_.follow(reference.cartesian, kTick);
    if (pose_joints_.prefers() && !elbow_is_clear(pose_joints_.joints().q)) pose_joints_.leave_elbow();
    joints_ = pose_joints_.joints();
  }
  robots_ = q_d != nullptr;
  if (reference.motion == Channels::kPose) {
    const double damping = robots_ ? Model::kNoDamping : Model::kCalm;
    ahead_ = model_.joints_of_pose(limiter_.joints_ahead(joints_.q), damping);
    limiter_.joints_follow(joints_, ahead_, robots_);
  }
}

Vector7 MotionGate::joint_velocity() const noexcept {
  const Reference& now = limiter_.last();
  return now.motion == Channels::kJoint ? now.joint.dq : Vector7(joints_.dq_dP * now.cartesian.velocity);
}

// The fastest that the tool becomes with the reference if it accelerates no more, m/s. Of a pose that is the limiter's to know.
double MotionGate::tool_speed() const noexcept {
  if (limiter_.last().motion != Channels::kJoint) return 0;
  const auto J = model_.jacobian().topRows<3>();
  return std::max((J * limiter_.last().joint.dq).norm(), (J * limiter_.joint_velocity_to_come()).norm());
}

// Whether the joints do more with it than may be asked for, or take more than the robot has; or bear more than they can.
HeldBy MotionGate::too_much_effort(const Reference& reference) const noexcept {
  const bool joints = reference.motion == Channels::kJoint;
  const Vector7 dq = joint_velocity();
  const Vector7 ddq = joints ? reference.joint.ddq : Vector7(joints_.dq_dP * reference.cartesian.acceleration);
  const Vector7 tau = felt_inertia(model_.mass()) * ddq + model_.coriolis();
  const bool bears_too_much = joints && (tau + gravity_).cwiseAbs().cwiseQuotient(tau_max_).maxCoeff() > kTorqueShare;
  return when(dq.dot(tau) > kPowerShare * bounds_.power || power_taken(tau + gravity_, dq) > kPowerShare * models::kMostPower,
              HeldBy::kPower) |
         when(bears_too_much, HeldBy::kTorqueLimits);
}

// `fastest`: of the tool, that is not yet too fast, m/s.
HeldBy MotionGate::beyond_bounds(const Reference& reference, double fastest) const noexcept {
  return when(tool_speed() > fastest, HeldBy::kToolSpeed) | too_much_effort(reference);
}

// So that they together do not move it faster.
void MotionGate::share_tool_speed(const Reference& wanted) noexcept {
  Vector7 dq = Vector7::Constant(std::numeric_limits<double>::infinity());
  if (slowed_ && wanted.motion == Channels::kJoint && is_finite(wanted)) {
    const Vector7 way = (wanted.joint.q - before_.joint.q).cwiseAbs() + kSoon * wanted.joint.dq.cwiseAbs();
    const double of_tool = model_.jacobian().topRows<3>().colwise().norm().dot(way);
    if (of_tool > kNoWay) dq = (kSlowShare * bounds_.tool_speed / of_tool * way).cwiseMax(kSlowest);
  }
  limiter_.bound(dq);
}

// Whether what is wanted of a pose lies farther out than its joints can be, or leads a robot's joints from next to a singular
// posture nearer to it: of an arm at rest the limiter does not know where its next step leads.
bool MotionGate::out_of_reach(const Reference& wanted) noexcept {
  if (before_.motion != Channels::kPose || wanted.motion != Channels::kPose || !is_finite(wanted)) return false;
  const Vector6 way = change_between(before_.cartesian, wanted.cartesian);
  if (!robots_) return pose_joints_.left().norm() > kLeftBehind && pose_joints_.left().dot(way) > 0;
  if (std::abs(joints_.determinant) > kNearlySingular) return false;
  const Vector7 turn = joints_.dq_dP * way;
  const Vector7 there = joints_.q + turn * (kLookAhead / std::max(turn.norm(), kLookAhead));
  return std::abs(model_.joints_of_pose(there).determinant) < std::abs(joints_.determinant);
}

// One step, and what held it back. One that would be beyond the bounds is made by joints that are slowed; where that does not do,
// all are braked.
HeldBy MotionGate::keep_to_bounds(const Reference& wanted, Shares& spared, Reference& reference) noexcept {
  const double before = tool_speed() + kNoFaster;
  const double fastest = kBoundShare * bounds_.tool_speed;
  share_tool_speed(wanted);
  bool limited = limiter_.follow(wanted, kTick, reference);
  slowed_ &= limited;
  HeldBy held = beyond_bounds(reference, slowed_ ? std::max(fastest, before) : fastest);
  if (has(held, HeldBy::kToolSpeed) && !slowed_) {
    slowed_ = true;
    limiter_.take_back();
    share_tool_speed(wanted);
    limited = limiter_.follow(wanted, kTick, reference);
    held = beyond_bounds(reference, std::max(fastest, before));
  }
  if (held != HeldBy::kNothing) {
    limiter_.take_back();
    if (has(held, HeldBy::kToolSpeed)) {
      // Sooner than on the way to rest: what leads to more speed is given back at once.
      limiter_.spare(spared.braking, spared.braking);
      limiter_.bound(Vector7::Constant(kSlowest));
      limited = limiter_.follow(wanted, kTick, reference);
    } else {
      if (has(held, HeldBy::kTorqueLimits)) {
        spared.braking = kLeastSpared;  // as joints bear what brakes them
        limiter_.spare(spared.braking, spared.catching_up);
      }
      limiter_.brake(kTick, reference);
    }
  }
  const bool pose_too_fast = wanted.motion == Channels::kPose && wanted.cartesian.velocity.head<3>().norm() > fastest;
  return held | when(limited, HeldBy::kMotionLimits) | when(slowed_ || (limited && pose_too_fast), HeldBy::kToolSpeed);
}

// A little farther than where motions end, so that the elbow leaves them room.
bool MotionGate::elbow_is_clear(const Vector7& q) noexcept {
  const ArmCapsules* const arm = walls_.arm();
  if (arm == nullptr) return true;
  const std::span<const Vector7> there(&q, 1);
  return self_.clear(*arm, joints_.q, there, kSelfClearance) &&
         (!walls_.active() || walls_.clear(joints_.q, there, WallGuard::kClearance + 2 * WallGuard::kTurnAround));
}

// Shares of the joints' acceleration that leave what they bear no more than they can: an arm that is stretched out, and comes down,
// cannot take all of it. Each joint may brake or catch up, whatever the others do, so that nothing of one may be counted on that
// relieves another.
MotionGate::Shares MotionGate::bearable() const noexcept {
  const Reference& now = limiter_.last();
  if (now.motion != Channels::kJoint) return {};
  const Vector7 held = gravity_ + model_.coriolis();
  // The slower a joint is, the less it brakes before it rests.
  const Vector7 brakes = ddq_max_.cwiseMin(brake_jerk_.cwiseProduct(now.joint.dq.cwiseAbs()).cwiseSqrt());
  struct Load {
    double room, braking = 0, catching_up = 0, given_back = 0;
  };
  std::array<Load, 2 * models::kJoints> loads;  // N m, of each joint to either side
  for (std::size_t k = 0; k < loads.size(); ++k) {
    const int i = static_cast<int>(k / 2);
    const double side = k % 2 == 0 ? -1 : 1;
    Load& load = loads[k] = {kTorqueShare * tau_max_[i] - side * held[i]};
    for (int j = 0; j < models::kJoints; ++j) {
      const double inertia = side * model_.mass()(i, j);
      if (inertia * now.joint.dq[j] < 0) {
        load.braking += std::abs(inertia) * brakes[j];
      } else {
        load.catching_up += std::abs(inertia) * ddq_max_[j];
        load.given_back += std::max(inertia * now.joint.ddq[j], 0.);
      }
    }
  }
  Shares shares;
  for (const Load& load : loads) {
    if (load.braking > 0) shares.braking = std::min(shares.braking, (load.room - load.given_back) / load.braking);
  }
  shares.braking = std::max(shares.braking, kLeastSpared);
  for (const Load& load : loads) {
    if (load.catching_up <= 0) continue;
    shares.catching_up = std::min(shares.catching_up, (load.room - shares.braking * load.braking) / load.catching_up);
  }
  shares.catching_up = std::clamp(shares.catching_up, kLeastSpared, shares.braking);
  return shares;
}

// Where the next reference would leave no clear way to rest, what of it leads past what is in the way is followed; and where that does
// not do either, the way to rest, which was clear the last time.
HeldBy MotionGate::follow(const Reference& wanted, Reference& reference) noexcept {
  before_ = reference;
  const Before met_before{met_, !limiter_.at_rest()};
  Shares spared = bearable();
  limiter_.spare(spared.braking, spared.catching_up);
  HeldBy held = keep_to_bounds(wanted, spared, reference);
  if (out_of_reach(wanted)) {
    limiter_.take_back();
    limiter_.brake(kTick, reference);
    held |= HeldBy::kMotionLimits;
  }
  const ArmCapsules* const arm = walls_.arm();
  const bool soon = soon_;
  met_ = arm == nullptr ? HeldBy::kNothing : meets(*arm, reference, met_before);
  held |= met_;
  if (met_ == HeldBy::kNothing) {
    spared_ = spared.braking;
    unseen_ = straight_ = false;
    return held;
  }
  limiter_.take_back();
  WallGuard::Bounds of_walls;
  SelfGuard::Bounds of_itself;
  const Reference aside = past(met_ == HeldBy::kWall ? walls_.bounds(of_walls) : self_.bounds(*arm, joints_.q, of_itself), wanted);
  if (!beside(aside, before_)) {
    limiter_.follow(aside, kTick, reference, straight_);
    if (meets(*arm, reference, {}) == HeldBy::kNothing &&
        beyond_bounds(reference, kBoundShare * bounds_.tool_speed) == HeldBy::kNothing) {
      spared_ = spared.braking;
      return held;
    }
    limiter_.take_back();
    // From rest by turns: where each joint goes as soon as it can that is another way than all together.
    straight_ = !straight_ && limiter_.at_rest();
  }
  limiter_.spare(spared_, spared.catching_up);  // as on the way that was clear
  soon_ = soon || unseen_ || reference.motion == Channels::kPose;  // the other way was not looked at
  limiter_.brake(kTick, reference, soon_);
  return held;
}

// What is in the way to rest: gently, and where that does not do as soon as may be. How soon a pose rests is known roughly only.
// From what was in the way `before` it has to keep away farther; and while it moves, whatever way that is: one that swings back
// would else be let go, and come again.
HeldBy MotionGate::meets(const ArmCapsules& arm, const Reference& reference, const Before& before) noexcept {
  const HeldBy met = meets(arm, reference, before, false);
  soon_ = met != HeldBy::kNothing && reference.motion != Channels::kPose;
  return soon_ ? meets(arm, reference, before, true) : met;
}

HeldBy MotionGate::meets(const ArmCapsules& arm, const Reference& reference, const Before& before, bool soon) noexcept {
  look_to_rest(reference, soon);
  const auto farther = [&](HeldBy from) { return before.met == from ? WallGuard::kTurnAround : 0; };
  const auto or_so = [&](HeldBy from) { return before.met != from || !before.turning; };
  const double from_itself = kSelfClearance + farther(HeldBy::kItself);
  if (!self_.clear(arm, joints_.q, way_to_rest(), from_itself, or_so(HeldBy::kItself))) return HeldBy::kItself;
  if (!walls_.active()) return HeldBy::kNothing;
  const double from_walls = WallGuard::kClearance + farther(HeldBy::kWall);
  return when(!walls_.clear(joints_.q, way_to_rest(), from_walls, or_so(HeldBy::kWall)), HeldBy::kWall);
}

bool MotionGate::brake(Reference& reference, bool soon) noexcept {
  before_ = reference;
  const ArmCapsules* const arm = walls_.arm();
  if (arm != nullptr && !soon_) {
    const auto is_clear = [&](bool how) { return meets(*arm, reference, {}, how) == HeldBy::kNothing; };
    soon_ = unseen_ && !is_clear(false);
    soon = soon && (soon_ || is_clear(true));
  }
  unseen_ = false;
  return limiter_.brake(kTick, reference, soon || soon_);
}

// The reference itself is a place of its own: between two others the way bends by little, but it would be left in every cycle anew.
void MotionGate::look_to_rest(const Reference& reference, bool soon) noexcept {
  if (reference.motion == Channels::kJoint) {
    joints_.q = before_.joint.q;
    way_[0] = reference.joint.q;
    places_ = 1 + limiter_.way_to_rest(std::span(way_).subspan(1), soon);
  } else {
    std::array<Vector6, WallGuard::kMostOnWay - 1> poses;
    places_ = 1 + limiter_.way_to_rest(std::span(poses));
    const Vector6 step = change_between(before_.cartesian, reference.cartesian);
    way_[0] = joints_.q + joints_.dq_dP * step;
    for (std::size_t k = 1; k < places_; ++k) {
      // The map changes along the way: on average by half of what it has changed there.
      const double share = static_cast<double>(k) / static_cast<double>(places_ - 1);
      way_[k] = joints_.q + (joints_.dq_dP + share / 2 * (ahead_.dq_dP - joints_.dq_dP)) * (step + poses[k - 1]);
    }
  }
}

// At rest, ahead of the reference before, as far as what is wanted leads there inside the bounds.
Reference MotionGate::past(std::span<const JointBound> bounds, const Reference& wanted) const noexcept {
  Reference aside = realtime::at_rest(before_);
  if (wanted.motion != before_.motion || !is_finite(wanted)) return aside;
  if (aside.motion == Channels::kJoint) {
    aside.joint.q += past_bounds(wanted.joint.q - before_.joint.q, bounds);
    return aside;
  }
  const Vector6 change = past_bounds(change_between(before_.cartesian, wanted.cartesian), joints_.dq_dP, bounds);
  aside.cartesian.position += change.head<3>();
  aside.cartesian.orientation = exp(change.tail<3>()) * before_.cartesian.orientation;
  return aside;
}

}  // namespace realtime
