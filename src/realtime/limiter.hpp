#pragma once

#include <memory>
#include <span>

#include "models/arm.hpp"
#include "realtime/reference.hpp"

namespace realtime {

// Keeps the reference inside the limits of the arm, whatever is asked for. The robot judges a reference
// by backward differences over its cycle of 1 ms: position (joints: with FR3's velocity envelope),
// velocity, acceleration, jerk; for poses the norms of translation and rotation. So does this.
//
// The robot also judges the joints that it moves along with a pose. They are its own choice, so that this can only
// foresee them, with a margin: from the map of one to the other where they are, and where they would come to rest. Next to
// a singularity the map changes so fast that a constant velocity of the pose accelerates joints; a pose goes only as fast
// there as leaves room to brake, and stops before one if the robot makes the joints.
//
// A reference that obeys is passed on unchanged. Any other is followed with a time-optimal, jerk-limited
// motion (Ruckig) until it can be passed on again; and every output leaves room to brake inside the
// limits from there. Free of allocation after construction; one call for each cycle of the robot.
class Limiter {
 public:
  // Of the determinant of the Jacobian of joints that a robot makes of a pose: below it that pose is not led at all.
  static constexpr double kSingular = 5e-4;
  // Of the limits of jerk, with which brake() comes to rest soon: a robot may lose one command.
  static constexpr double kSoonJerk = 0.24;

  explicit Limiter(const models::Limits& limits);
  ~Limiter();

  // From now on what follow() is asked for, and what it plans to catch up, keeps to these limits too, each at most the arm's; a
  // motion that is beyond is slowed inside the arm's. Braking and losses go by the arm's own.
  void reduce(const models::Limits& asked) noexcept;

  // Likewise to these velocities of the joints (rad/s, may be infinite), from the next follow() on.
  void bound(const Vector7& dq) noexcept;

  // Likewise joints brake and catch up with these shares of what they may accelerate with, each at most 1.
  void spare(double braking, double catching_up) noexcept;

  // Continues from here: what the robot has as its last command. Motion, position, velocity and
  // acceleration count. To be called before all else, and whenever the reference jumps on purpose
  // (another motion, re-based by a controller, lost to an error). True if it is the last output, from which nothing jumps.
  bool reset(const Reference& from) noexcept;

  // For a pose that the robot's joints are to follow: to be called before each step, until reset() begins something new.
  // `ahead` is the map at joints_ahead(joints.q). `robots`: the robot makes the joints, of which nobody knows how it damps them
  // next to a singularity; ours go through one where the pose asks for nothing that they cannot do there.
  void joints_follow(const JointsOfPose& joints, const JointsOfPose& ahead, bool robots = true) noexcept;

  // About where the joints that follow a pose would be halfway to rest.
  Vector7 joints_ahead(const Vector7& q) const noexcept;

  // Whether the joints that follow a pose keep their limits, and have room to come to rest, if it goes on with the velocity that
  // it has; those that a robot makes have none next to a singularity.
  bool has_room() noexcept;

  // Next output for what is wanted in this cycle; dt in s. True if it had to hold something back.
  // A reference that is not finite, or of another motion than the one continued from, is braked for. What is caught up with is so
  // in the shortest time of each joint; `straight`: from rest on a straight way.
  bool follow(const Reference& wanted, double dt, Reference& out, bool straight = false) noexcept;

  // Next output on the way to rest, in the shortest time; true when at rest. `soon`: with as much of the jerk as leaves a robot
  // that loses one command inside its limits, and not with the little with which it may lose three.
  bool brake(double dt, Reference& out, bool soon = false) noexcept;

  // As if the last follow() had not been: the next output continues from the one before it.
  void take_back() noexcept;

  // The way that brake() would make from the last output on: places on it, the last one where it would rest. The first so many
  // of `out` are set: joints, or how far away from the last output in m and rad, axes of O.
  std::size_t way_to_rest(std::span<Vector7> joints, bool soon) noexcept;
  std::size_t way_to_rest(std::span<Vector6> pose) const noexcept;

  // The cycle went without a command: the robot extrapolates with constant acceleration, and so does
  // this; `out` is where the robot now is.
  void coast(double dt, Reference& out) noexcept;

  // Outputs may never have come to the robot, which then went on as for coast(). `robots`: its reference so many cycles (>= 1)
  // after the last output, for all but one of which coast() is still to come: positions, and velocities and accelerations,
  // which are backward differences; each off by at most `rounding`, rad, m and rad/s. True when the last output, or more of those
  // before it, did not come; `out` is then where the robot was one cycle after the last. Where it is otherwhere than either way,
  // what it says itself counts: so it begins from a position that was rounded, or took a late one.
  bool reconcile(const Reference& robots, int cycles, double rounding, double dt, Reference& out) noexcept;

  // The last output.
  const Reference& last() const noexcept;

  // Velocities to which its joints come while follow() gives their acceleration back, rad/s.
  Vector7 joint_velocity_to_come() const noexcept;

  // The last output moves no more.
  bool at_rest() const noexcept;

  // Has not come nearer to what is wanted for half a second, as limits are in the way.
  bool stuck() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Keeps a torque inside the arm's limits of torque and torque rate.
class TorqueLimiter {
 public:
  explicit TorqueLimiter(const models::Limits& limits);

  // From now on limit() takes torques for those beside what the joints bear anyhow (N m, gravity): both together keep to the limits
  // as well.
  void beside(const Vector7& borne) noexcept;

  // The greatest of these torques, by what that joint can give.
  double share(const Vector7& tau) const noexcept { return tau.cwiseAbs().cwiseQuotient(tau_max_).maxCoeff(); }

  const Vector7& rate() const noexcept { return dtau_max_; }  // N m/s

  // What of the way from one torque, inside the limits of torque, to another is so.
  double share_inside(const Vector7& from, const Vector7& to) const noexcept;

  // Brings the whole vector inside the limits, in its direction, from `last`, which was commanded dt seconds before; N m. True if
  // it had to. One that is not finite is taken for zero.
  bool scale(const Vector7& wanted, const Vector7& last, double dt, Vector7& out) const noexcept;

  // The same for each joint by itself. An element that is not finite is taken for zero.
  bool limit(const Vector7& wanted, const Vector7& last, double dt, Vector7& out) const noexcept;

 private:
  Vector7 tau_max_, dtau_max_;
  Vector7 least_, most_;  // N m, on both sides of 0
};

}  // namespace realtime
