#pragma once

#include "sim/robot/rigid_body.hpp"
#include "wire/fci/service.hpp"

namespace sim {

// What clients can set in the robot, as it is after power-on. What of this Franka does not publish is said in the
// source.
struct Settings {
  Settings();

  fci::SetCollisionBehavior collision;
  fci::SetJointImpedance joint_impedance;
  fci::SetCartesianImpedance cartesian_impedance;
  fci::SetGuidingMode guiding;
  fci::SetFilters filters;
  fci::Pose EE_T_K = fci::kIdentityPose, NE_T_EE = fci::kIdentityPose;
  RigidBody end_effector, load;  // in the flange frame
  Eigen::Matrix4d F_T_NE;

  Eigen::Matrix4d F_T_EE() const;
  bool operator==(const Settings&) const = default;

  // Whether the robot takes what is asked for; NaN it never does.
  static bool valid(const fci::SetCollisionBehavior& request);
  static bool valid(const fci::SetJointImpedance& request);
  static bool valid(const fci::SetCartesianImpedance& request);
  static bool valid(const fci::SetGuidingMode&) { return true; }
  static bool valid(const fci::SetEEToK& request);
  static bool valid(const fci::SetNEToEE& request);
  static bool valid(const fci::SetLoad& request);
  static bool valid(const fci::SetFilters& request);

  void take(const fci::SetCollisionBehavior& request) { collision = request; }
  void take(const fci::SetJointImpedance& request) { joint_impedance = request; }
  void take(const fci::SetCartesianImpedance& request) { cartesian_impedance = request; }
  void take(const fci::SetGuidingMode& request) { guiding = request; }
  void take(const fci::SetEEToK& request) { EE_T_K = request.EE_T_K; }
  void take(const fci::SetNEToEE& request) { NE_T_EE = request.NE_T_EE; }
  void take(const fci::SetLoad& request);
  void take(const fci::SetFilters& request) { filters = request; }
};

// Hz: a command filter at this frequency is off.
inline constexpr double kNoFilter = 1000;

}  // namespace sim
