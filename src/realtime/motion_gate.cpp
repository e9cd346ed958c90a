#include "realtime/motion_gate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "realtime/rotation.hpp"

namespace realtime {
namespace {

constexpr double kBeside = 2e-3;  // rad, m

constexpr double kReach = 0.5;  // m that a tool moves when a joint turns by a radian, about

// So near to each other that an arm which a wall holds up does not stir for it.
bool beside(const Reference& a, const Reference& b) {
  if (a.motion == Channels::kJoint) return (a.joint.q - b.joint.q).norm() < kBeside;
  return (a.cartesian.position - b.cartesian.position).norm() < kBeside &&
         a.cartesian.orientation.angularDistance(b.cartesian.orientation) < kBeside;
}

}  // namespace

void MotionGate::reset(const Reference& from) noexcept {
  before_ = from;
  walled_ = false;
  limiter_.reset(from);
}

void MotionGate::observe(const Reference& reference, const Vector7* q_d) noexcept {
  if (reference.motion == Channels::kJoint) {
    joints_.q = reference.joint.q;
  } else if (q_d != nullptr) {
    joints_ = model_.joints_of_pose(*q_d);
  } else {
    pose_joints_.place(joints_.q);
    pose_joints_.step(reference.cartesian, kTick);
    joints_ = pose_joints_.joints();
  }
  if (reference.motion == Channels::kPose) {
    limiter_.joints_follow(joints_, model_.joints_of_pose(limiter_.joints_ahead(joints_.q)), q_d != nullptr);
  }
}

Vector7 MotionGate::joint_velocity() const noexcept {
  const Reference& now = limiter_.last();
  return now.motion == Channels::kJoint ? now.joint.dq : Vector7(joints_.dq_dP * now.cartesian.velocity);
}

double MotionGate::away(const Cycle& cycle) const noexcept {
  const Reference& now = limiter_.last();
  if (now.motion == Channels::kJoint) return (now.joint.q - cycle.q).cwiseAbs().maxCoeff();
  const Vector6 way = change_between(at(cycle.O_T_EE), now.cartesian);
  return std::max(way.head<3>().norm() / kReach, way.tail<3>().norm());
}

// Where the next reference would leave no clear way to rest, what of it leads past the walls is followed; and where that does
// not do either, the way to rest, which was clear the last time.
HeldBy MotionGate::follow(const Reference& wanted, Reference& reference) noexcept {
  before_ = reference;
  HeldBy held = when(limiter_.follow(wanted, kTick, reference), HeldBy::kMotionLimits);
  const ArmCapsules* const arm = walls_.arm();
  if (arm == nullptr) return held;
  look_to_rest(reference);
  if (!self_.clear(*arm, joints_.q, way_to_rest())) {
    limiter_.take_back();
    limiter_.brake(kTick, reference);
    return held | HeldBy::kItself;
  }
  if (!walls_.active()) return held;
  const bool clear = walls_.clear(joints_.q, way_to_rest(), WallGuard::kClearance + (walled_ ? WallGuard::kTurnAround : 0));
  if (!clear) {
    const Reference aside = past_walls(wanted);
    limiter_.take_back();
    bool along = !beside(aside, before_);
    if (along) {
      limiter_.follow(aside, kTick, reference);
      look_to_rest(reference);
      along = walls_.clear(joints_.q, way_to_rest(), WallGuard::kClearance) && self_.clear(*arm, joints_.q, way_to_rest());
      if (!along) limiter_.take_back();
    }
    if (!along) limiter_.brake(kTick, reference);
    held |= HeldBy::kWall;
  }
  walled_ = !clear;
  return held;
}

bool MotionGate::brake(Reference& reference) noexcept {
  before_ = reference;
  return limiter_.brake(kTick, reference);
}

void MotionGate::look_to_rest(const Reference& reference) noexcept {
  if (reference.motion == Channels::kJoint) {
    joints_.q = before_.joint.q;
    places_ = limiter_.way_to_rest(std::span(way_));
  } else {
    std::array<Vector6, WallGuard::kMostOnWay> poses;
    places_ = limiter_.way_to_rest(std::span(poses));
    const Vector6 step = change_between(before_.cartesian, reference.cartesian);
    for (std::size_t k = 0; k < places_; ++k) way_[k] = joints_.q + joints_.dq_dP * (step + poses[k]);
  }
}

// At rest, ahead of the reference before, as far as what is wanted leads there without the walls.
Reference MotionGate::past_walls(const Reference& wanted) const noexcept {
  Reference aside = realtime::at_rest(before_);
  if (wanted.motion != before_.motion || !is_finite(wanted)) return aside;
  if (aside.motion == Channels::kJoint) {
    aside.joint.q += walls_.past(wanted.joint.q - before_.joint.q);
    return aside;
  }
  const Vector6 change = walls_.past(change_between(before_.cartesian, wanted.cartesian), joints_.dq_dP);
  aside.cartesian.position += change.head<3>();
  aside.cartesian.orientation = exp(change.tail<3>()) * before_.cartesian.orientation;
  return aside;
}

}  // namespace realtime
