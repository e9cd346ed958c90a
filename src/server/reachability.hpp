#pragma once

#include "models/arm.hpp"
#include "realtime/model.hpp"

namespace server {

// How near joints within their limits bring the end effector to a pose.
struct Reach {
  bool reached = false;
  realtime::Vector7 q = realtime::Vector7::Zero();  // of the nearest found, rad
  Eigen::Isometry3d O_T_EE = Eigen::Isometry3d::Identity();  // there
  double distance = 0;                              // left, m
  double angle = 0;                                 // left, rad
  int tried = 0;                                    // postures beside `q`
};

// Inverse kinematics by damped least squares (damping after Sugihara, "Solvability-unconcerned inverse
// kinematics by the Levenberg-Marquardt method", 2011), with joints that run into a limit taken out of
// the step; limits here are where joints may come to rest. First from `q`; where that ends short of the pose, from a fixed set of postures. The tool
// is the model's.
Reach reach(realtime::Model& model, const models::Limits& limits, const Eigen::Isometry3d& O_T_EE,
            const realtime::Vector7& q);

}  // namespace server
