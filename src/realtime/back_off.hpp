#pragma once

#include "realtime/model.hpp"
#include "realtime/soft_ending.hpp"
#include "realtime/trajectories/min_jerk.hpp"

namespace realtime {

// The way back of an arm that has touched something: straight against the motion that EE had, with least jerk. Joints go as they
// came, so that whatever of the arm touched comes free; EE goes the distance as far as its Jacobian says. Where EE hardly moved, or
// joints turned and it hardly along with them, it goes with the force that pushes it.
class BackOff {
 public:
  // `reference` moves as it did when the contact was noticed; `pushes`: the force on EE, N, axes of O; q: measured, rad, where the
  // model is.
  void plan(const SoftEnding& ending, const Reference& reference, const Vector3& pushes, const Vector7& q, Model& model) noexcept;

  bool active() const noexcept { return active_; }
  void stop() noexcept { active_ = false; }

  // What is wanted a tick later, on the way from a reference that rests, which the first call takes. True when it is over.
  bool step(const Reference& reference, Reference& wanted) noexcept;
  bool begun() const noexcept { return begun_; }

 private:
  bool active_ = false, begun_ = false;
  Vector7 joints_ = Vector7::Zero();  // rad
  Vector3 way_ = Vector3::Zero();     // m
  Reference from_;
  MinJerk<1> share_;  // of the way
  double time_ = 0;   // s
};

}  // namespace realtime
