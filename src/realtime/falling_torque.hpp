#pragma once

#include "realtime/model.hpp"
#include "realtime/walls/wall_guard.hpp"

namespace realtime {

// Between which speeds are to stay, and what the joints may do together; to walls nothing may come too fast.
struct SpeedBounds {
  Vector7 dq_min, dq_max;  // rad/s
  double tool;             // m/s, of the origin of EE; may be infinite, as may
  double power;            // W
  double taken;            // W, by the joints that drive, gravity included
  double to_walls = 0;     // m/s, WallGuard::too_fast()
};

// What becomes of an arm whose torque falls as fast as the robot lets it: all of it together, in a straight line to where it makes
// the arm no faster, so that a joint which has far to go does not leave the others alone with what it holds. With u what it falls
// by and r the rate, in T = max |u| / r, it until then changes the velocity by M^-1 u T / 2, in a straight line as well: what keeps
// to the bounds at both ends does so between. And after a torque from which it does so comes one from which it does: the next on
// that line. As the arm moves meanwhile, and M with it, half as much again is counted on.
class FallingTorque {
 public:
  // `sent`: the last torque, which acts in this cycle (N m); `rest`: that with which the joints do not accelerate; `gravity`: what
  // they bear beside; `mobility`: joint_mobility() (1/(kg m²)); `rate`: N m/s, at which each torque may fall; `walls`: after add().
  // All must outlive this.
  FallingTorque(const Model& model, const Vector7& dq, const Matrix7& mobility, const Vector7& rest, const Vector7& gravity,
                const Vector7& rate, const Vector7& sent, const WallGuard& walls) noexcept;

  // Velocities when the next torque begins to act, rad/s.
  const Vector7& dq() const noexcept { return dq_; }

  // Whether the arm keeps to the bounds if it falls from this torque to `rest`.
  bool keeps(const SpeedBounds& bounds, const Vector7& tau) const noexcept;

  // For a torque of which that is not so and which may follow the last: what of the way to it from the next one of a fall to
  // `goal` leads to no place from which the bounds would be left, or left farther than from there. `goal` makes neither tool nor
  // joints faster, and slows what is too fast.
  void hold(const SpeedBounds& bounds, const Vector7& goal, Vector7& tau) const noexcept;

 private:
  // Of a fall from tau to `to`: the velocities at its end, and the greatest speed (m/s) and powers (W) on the way; and how fast it
  // would come to walls if it were braked instead.
  struct Fall {
    Vector7 dq;
    double tool, power, taken, to_walls;

    bool keeps(const SpeedBounds& bounds) const noexcept;
  };
  // `turning`: how the tool accelerates there although the joints do not, m/s².
  Fall fall(const Vector7& tau, const Vector7& to, const Vector3& turning) const noexcept;
  double time(const Vector7& u) const noexcept { return u.cwiseAbs().cwiseQuotient(rate_).maxCoeff(); }

  const Model& model_;
  const Matrix7& mobility_;
  const Vector7 &rest_, &gravity_, &rate_, &sent_;
  const WallGuard& walls_;
  Vector7 dq_;
};

}  // namespace realtime
