#pragma once

#include <array>
#include <optional>
#include <span>

#include "models/arm.hpp"
#include "realtime/bounds.hpp"
#include "realtime/cycle.hpp"
#include "realtime/held_by.hpp"
#include "realtime/limiter.hpp"
#include "realtime/model.hpp"
#include "realtime/pose_joints.hpp"
#include "realtime/tick.hpp"
#include "realtime/walls/self_guard.hpp"
#include "realtime/walls/wall_guard.hpp"

namespace realtime {

// Where every reference goes through before it is sent, whatever robot controller runs: it judges the motion of the joints that
// the reference means. Those of a pose are the robot's own where it makes them (q_d); else they follow the pose here, by
// differential inverse kinematics from where the arm was, and are also what the null space of a controller is held to.
// A reference is kept inside the limits of the arm, on a way from which the arm can come to rest before it meets itself or a wall,
// and inside the bounds of what may be asked for. Where joints would together move the tool faster than these or the robot allow,
// each gets its share of that speed, by how far it has to go.
class MotionGate {
 public:
  MotionGate(const models::Limits& limits, Model& model);

  // From now on.
  void keep_to(const Bounds& bounds) noexcept;
  // The same of walls and of the body of the arm; as WallGuard::change().
  Walls* keep_from(Walls* walls) noexcept;

  // The reference is no more where a step has led it, as commands did not come to the robot: its way to rest was not looked at.
  void strayed() noexcept { unseen_ = true; }

  // Continues from here. A pose that does not go on from what was commanded before has its joints where the arm is, q (rad).
  void reset(const Reference& from) noexcept;
  void place(const Vector7& q) noexcept;

  // The posture that joints which follow a pose here are led near, rad, as far as they meet neither a wall nor the arm itself.
  void prefer(const std::optional<Vector7>& posture) noexcept { pose_joints_.prefer(posture); }

  // Once in each cycle, before its steps: where the joints of the reference are, and the gravity that they bear, N m. `q_d`: those
  // that the robot makes of a pose, or null where they are to follow it here.
  void observe(const Reference& reference, const Vector7& gravity, const Vector7* q_d) noexcept;

  // The reference one tick on, for what is wanted, and what held it back; on the way to rest, true if it is at rest. `soon`: as
  // Limiter::brake(), unless something is in the way that it makes so.
  HeldBy follow(const Reference& wanted, Reference& reference) noexcept;
  bool brake(Reference& reference, bool soon = false) noexcept;

  // The reference before the last step.
  const Reference& before() const noexcept { return before_; }
  // About where the joints are with it.
  const JointsOfPose& joints() const noexcept { return joints_; }
  Vector7 joint_velocity() const noexcept;  // rad/s
  bool at_rest() const noexcept { return limiter_.at_rest(); }
  bool stuck() const noexcept { return limiter_.stuck(); }

  Limiter& limiter() noexcept { return limiter_; }
  WallGuard& walls() noexcept { return walls_; }

 private:
  // Of the joints' acceleration.
  struct Shares {
    double braking = 1, catching_up = 1;
  };

  bool out_of_reach(const Reference& wanted) noexcept;
  HeldBy keep_to_bounds(const Reference& wanted, Shares& spared, Reference& reference) noexcept;
  HeldBy beyond_bounds(const Reference& reference, double fastest) const noexcept;
  double tool_speed() const noexcept;
  HeldBy too_much_effort(const Reference& reference) const noexcept;
  void share_tool_speed(const Reference& wanted) noexcept;
  bool elbow_is_clear(const Vector7& q) noexcept;
  // What it did before, if anything, and whether it still turns away from that.
  struct Before {
    HeldBy met = HeldBy::kNothing;
    bool turning = false;
  };
  HeldBy meets(const ArmCapsules& arm, const Reference& reference, const Before& before) noexcept;
  HeldBy meets(const ArmCapsules& arm, const Reference& reference, const Before& before, bool soon) noexcept;
  void look_to_rest(const Reference& reference, bool soon) noexcept;
  Shares bearable() const noexcept;
  std::span<const Vector7> way_to_rest() const noexcept { return std::span(way_).first(places_); }
  Reference past(std::span<const JointBound> bounds, const Reference& wanted) const noexcept;

  Model& model_;
  Bounds bounds_;
  double robots_tool_speed_;  // m/s, that it allows
  Vector7 gravity_ = Vector7::Zero();  // N m
  Vector7 ddq_max_, brake_jerk_, tau_max_;  // of the robot
  double spared_ = 1;                  // share of its acceleration with which the arm comes to rest on a way that is clear
  Limiter limiter_;
  WallGuard walls_;
  SelfGuard self_;
  std::array<Vector7, WallGuard::kMostOnWay> way_;  // to rest, of the joints; so many places of it
  std::size_t places_ = 0;
  PoseJoints pose_joints_;
  JointsOfPose joints_, ahead_;  // now, and of a pose about where it would rest
  Reference before_;
  bool robots_ = false;  // makes the joints of a pose itself
  HeldBy met_ = HeldBy::kNothing;  // what was in the way in the step before
  bool unseen_ = false;  // since it was last looked to rest something has come, or the reference elsewhere
  bool soon_ = false;    // it comes to rest before what is in the way only if it brakes soon
  bool straight_ = false;  // it goes past what is in the way with all joints together
  bool slowed_ = false;  // joints, since the tool would have been too fast, until they have caught up
};

}  // namespace realtime
