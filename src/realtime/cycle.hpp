#pragma once

#include "realtime/model.hpp"
#include "realtime/reference.hpp"
#include "wire/fci/robot_state.hpp"

namespace realtime {

// What a component of a skill sees in one cycle.
struct Cycle {
  const fci::RobotState& state;
  const Model& model;       // updated for q and dq while the robot takes torques
  double time = 0;          // s of the robot's clock since the reference that the skill began from
  double dt = 0.001;        // s since the cycle before; more than 1 ms when states were lost
  Vector7 q = Vector7::Zero(), dq = Vector7::Zero();         // measured
  Eigen::Isometry3d O_T_EE = Eigen::Isometry3d::Identity();  // measured
  Vector7 q_ref = Vector7::Zero(), dq_ref = Vector7::Zero();  // joints that the reference means (MotionGate); rad, rad/s
  Vector7 tau_J_d = Vector7::Zero();  // last commanded torque, ours in double; zero outside torque control
};

}  // namespace realtime
