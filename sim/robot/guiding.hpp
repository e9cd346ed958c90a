#pragma once

#include "sim/robot/arm_model.hpp"
#include "wire/fci/service.hpp"

namespace sim {

// The law of an arm that a hand guides: weightless, lightly damped, and free along the axes that are unlocked; a stiff
// spring keeps the others, and the elbow when it is locked, where they were. Not published: the axes' frame, here O
// (about the end effector), and the springs.
class Guiding {
 public:
  using Vector7 = Eigen::Matrix<double, 7, 1>;

  void start(const fci::SetGuidingMode& unlocked, const ArmModel& model, const Eigen::Matrix4d& F_T_EE,
             const Vector7& q);
  // Torque of one cycle without gravity, N m; the model is at q and dq.
  Vector7 torque(const ArmModel& model, const Eigen::Matrix4d& F_T_EE, const Vector7& q, const Vector7& dq);

 private:
  fci::SetGuidingMode unlocked_;
  Eigen::Matrix4d O_T_EE_d_;
  double q3_ = 0;  // rad
};

}  // namespace sim
