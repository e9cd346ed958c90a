#pragma once

#include "models/arm.hpp"
#include "realtime/model.hpp"

namespace realtime {

// Under torque control nothing else keeps the measured joints from the ends of their range, or from a speed, at which the
// robot stops by an error: a soft controller lets itself be pushed there, a Cartesian one goes there near a singularity.
// Keeps what a controller's torque makes of the joints, ddq = M^-1 (tau_J_d - c), from taking one to a speed that could not
// be braked in time: ddq <= k (v - dq) + dv/dt towards the end, v the greatest speed there (a control barrier: Ames et al.,
// Control barrier functions: theory and applications, ECC 2019), by the least torque of the joints concerned. Pushes back
// at the end. Otherwise it adds nothing.
class JointBarrier {
 public:
  explicit JointBarrier(const models::Limits& limits);

  // From now on keeps to these velocities too.
  void reduce(const models::Limits& asked) noexcept { asked_ = asked.dq_max; }

  // How its reference moves (rad/s), and how far away from it the arm is (rad). One that is far, as something held it, goes
  // back slowly, all of the way; a hand that pushes it farther is not hindered.
  // `pushed`: the acceleration by what else acts on the joints (rad/s²), which is minded where it makes one faster: what slows it
  // may let go.
  struct Lead {
    Vector7 dq = Vector7::Zero();
    double away = 0;
    Vector7 pushed = Vector7::Zero();
  };

  // Another motion that is to be braked, as that of the tool: by which the joints' acceleration is at most gradient . ddq, by a
  // torque along that; of the torques of all, the joints' speeds go first.
  struct Brake {
    Vector7 gradient;
    double most;       // 1/s² of what it is the gradient of
    double force = 0;  // that it took
  };

  // Adds to tau_J_d, N m; `mobility` is joint_mobility() at q, c the torque with which the joints do not
  // accelerate (N m). True if it had to.
  bool add(const Vector7& q, const Vector7& dq, const Matrix7& mobility, const Vector7& c, const Lead& lead,
           Vector7& tau_J_d, Brake* brake = nullptr) noexcept;

  // Between which it keeps the joints in this cycle, rad/s.
  const Vector7& dq_min() const noexcept { return dq_min_; }
  const Vector7& dq_max() const noexcept { return dq_max_; }

 private:
  models::Limits limits_;
  models::Vector7 asked_;  // greatest velocities, rad/s
  Vector7 end_min_, end_max_;  // where pushing back begins, rad
  Vector7 dq_min_, dq_max_;
  bool returns_ = false;       // from afar, and is not there yet
};

}  // namespace realtime
