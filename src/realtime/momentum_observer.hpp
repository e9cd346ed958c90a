#pragma once

#include "realtime/model.hpp"
#include "wire/fci/robot_state.hpp"

namespace realtime {

// What pushes the arm, whatever moves it, from the momentum p = M(q) dq of its links:
//
//   r = K (p(t) - p(0) - ∫ (tau_J + C^T(q, dq) dq - g(q) + r) dt),   so that   dr/dt = K (tau_ext - r)
//
// (De Luca, Albu-Schäffer, Haddadin, Hirzinger, Collision detection and safe reaction with the DLR-III lightweight robot arm,
// IROS 2006.) No acceleration is needed, and r is what acts from outside behind a low-pass of K / 2 pi. C^T dq is found as
// (dM/dt) dq - C dq.
//
// Of torques it takes the measured tau_J, which is there in every mode of the robot, and which is behind motor and gear: their
// inertia and friction (models/joint_figures.hpp) are no part of that balance. From the commanded torque both would have to be
// taken off, and their error would be felt as a contact; the robot's own controllers do not tell theirs.
//
// K is so high that a contact which grows by 1 N/ms is seen some 3 ms later, and as low as noise allows: the robot's own estimate,
// low-passed at some 15 Hz, comes 10 ms later.
//
// Signs are the robot's, of tau_ext_hat_filtered and O_F_ext_hat_K: what the arm exerts, the opposite of r.
class MomentumObserver {
 public:
  static constexpr double kGain = 300;  // K, 1/s

  // Above what the motion of a free arm makes of noise and of what sensors and model do not know: then it is a collision. N m; of
  // the wrench N, N m.
  static const Vector7 kTorqueThresholds;
  static const Vector6 kForceThresholds;

  // Begins anew: the load that it knows has changed.
  void reset() noexcept { began_ = false; }

  // One cycle, `ticks` ms after the one before; the model is at its q and dq. Where states were lost it goes on from what it
  // knew: nobody has seen the torques in between.
  void update(const fci::RobotState& state, const Model& model, std::uint64_t ticks) noexcept;

  const Vector7& tau_ext() const noexcept { return tau_ext_; }  // N m
  const Vector6& O_F_ext_K() const noexcept { return O_F_ext_K_; }  // at the stiffness frame K, axes of O; N, N m
  bool collision() const noexcept;

 private:
  bool began_ = false;
  Matrix7 M_;                          // of the cycle before
  Vector7 dq_, bias_;                  // rad/s; C dq + g, N m
  Vector7 expected_;                   // p, N m s, if nothing pushed beyond r
  Vector7 tau_ext_ = Vector7::Zero();
  Vector6 O_F_ext_K_ = Vector6::Zero();
};

}  // namespace realtime
