#pragma once

#include "sim/robot/arm_model.hpp"
#include "sim/robot/sensors.hpp"

namespace sim {

// What pushes the arm, as it can tell: the torques at its links less those that its model needs for the motion, with
// end effector and load as configured, low-passed. Signs are the real arm's: what the arm exerts, so an arm that is
// pushed down reports an upward force (libfranka issue 26).
class ExternalForce {
 public:
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Vector7 = Eigen::Matrix<double, 7, 1>;

  // One cycle; the model is at the sensors' q and dq. F_T_K: frame in which the wrench acts.
  void update(const ArmModel& model, const Sensors& sensors, const Eigen::Matrix4d& F_T_K);

  Vector7 tau = Vector7::Zero();      // N m
  Vector6 O_F_K = Vector6::Zero();    // N, N m: at the origin of K, axes of O
  Vector6 K_F_K = Vector6::Zero();    // the same in axes of K

 private:
  Vector7 bias_;  // of the cycle before
  bool started_ = false;
};

}  // namespace sim
