#pragma once

#include "models/arm.hpp"
#include "realtime/trajectories/min_jerk.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// Along a path of joint positions that was made for a start. Where the reference is elsewhere when it begins, or moves,
// the difference fades away by MinJerk, added to the path. Until it has, a path that asks for that is waited for at its
// start.
class JointPath : public TrajectoryGenerator {
 public:
  Channels fills() const noexcept override { return Channels::kJoint; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return std::max(wait_ + length_, fading_.duration()); }
  double stretch() const noexcept override { return stretch_; }

 protected:
  explicit JointPath(const models::Limits& limits) : limits_(limits) {}

  // At t s since its start, 0 to length_.
  virtual JointReference at(double t) const noexcept = 0;

  models::Limits limits_;
  Reference goal_;
  // Of the path, s; its stretching; and s after which nothing should be left of the difference, infinite where it may.
  double length_ = 0, stretch_ = 1, clear_after_ = 0;

 private:
  MinJerk<7> fading_;
  double wait_ = 0;  // s
};

// Raises `worst`, see raise(), by a motion of the joints; FR3's envelope included.
void raise_by_joints(const models::Limits& limits, double share, const Vector7& q, const Vector7& dq,
                     const Vector7& ddq, const Vector7& dddq, double& worst) noexcept;

}  // namespace realtime
