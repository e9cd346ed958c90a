#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

namespace fci {

inline constexpr std::size_t kErrorCount = 41;

// Bits of RobotState::errors and RobotState::reflex_reason, by the index on the wire.
using Errors = std::array<bool, kErrorCount>;

// libfranka's names (franka/errors.h), in wire order.
inline constexpr std::array<std::string_view, kErrorCount> kErrorNames = {
    "joint_position_limits_violation",
    "cartesian_position_limits_violation",
    "self_collision_avoidance_violation",
    "joint_velocity_violation",
    "cartesian_velocity_violation",
    "force_control_safety_violation",
    "joint_reflex",
    "cartesian_reflex",
    "max_goal_pose_deviation_violation",
    "max_path_pose_deviation_violation",
    "cartesian_velocity_profile_safety_violation",
    "joint_position_motion_generator_start_pose_invalid",
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
    "cartesian_position_motion_generator_start_pose_invalid",
    "cartesian_motion_generator_elbow_limit_violation",
    "cartesian_motion_generator_velocity_limits_violation",
    "cartesian_motion_generator_velocity_discontinuity",
    "cartesian_motion_generator_acceleration_discontinuity",
    "cartesian_motion_generator_elbow_sign_inconsistent",
    "cartesian_motion_generator_start_elbow_invalid",
    "force_controller_desired_force_tolerance_violation",
    "start_elbow_sign_inconsistent",
    "communication_constraints_violation",
    "power_limit_violation",
    "cartesian_motion_generator_joint_position_limits_violation",
    "cartesian_motion_generator_joint_velocity_limits_violation",
    "cartesian_motion_generator_joint_velocity_discontinuity",
    "cartesian_motion_generator_joint_acceleration_discontinuity",
    "cartesian_position_motion_generator_invalid_frame",
    "controller_torque_discontinuity",
    "joint_p2p_insufficient_torque_for_planning",
    "tau_j_range_violation",
    "instability_detected",
    "joint_move_in_wrong_direction",
    "cartesian_spline_motion_generator_violation",
    "joint_via_motion_generator_planning_joint_limit_violation",
    "base_acceleration_initialization_timeout",
    "base_acceleration_invalid_reading",
};

enum class Error : std::size_t {
  kJointPositionLimits = 0,
  kCartesianPositionLimits = 1,
  kSelfCollisionAvoidance = 2,
  kJointVelocity = 3,
  kCartesianVelocity = 4,
  kForceControlSafety = 5,
  kJointReflex = 6,
  kCartesianReflex = 7,
  kMaxGoalPoseDeviation = 8,
  kMaxPathPoseDeviation = 9,
  kJointStartPoseInvalid = 11,
  kJointPositionLimitsCommanded = 12,
  kJointVelocityLimitsCommanded = 13,
  kJointVelocityDiscontinuity = 14,
  kJointAccelerationDiscontinuity = 15,
  kCartesianStartPoseInvalid = 16,
  kCartesianElbowLimit = 17,
  kCartesianVelocityLimits = 18,
  kCartesianVelocityDiscontinuity = 19,
  kCartesianAccelerationDiscontinuity = 20,
  kCartesianElbowSignInconsistent = 21,
  kCartesianStartElbowInvalid = 22,
  kStartElbowSignInconsistent = 24,
  kCommunicationConstraints = 25,
  kPowerLimit = 26,
  kCartesianJointPositionLimits = 27,
  kCartesianJointVelocityLimits = 28,
  kCartesianJointVelocityDiscontinuity = 29,
  kCartesianJointAccelerationDiscontinuity = 30,
  kCartesianInvalidFrame = 31,
  kControllerTorqueDiscontinuity = 32,
  kTauJRange = 34,
  kInstabilityDetected = 35,
  kJointMoveInWrongDirection = 36,
};

constexpr std::string_view name(Error error) {
  return kErrorNames[static_cast<std::size_t>(error)];
}

constexpr bool any(const Errors& errors) {
  for (bool error : errors) {
    if (error) return true;
  }
  return false;
}

// "joint_reflex, cartesian_reflex"; empty when no bit is set.
inline std::string names(const Errors& errors) {
  std::string text;
  for (std::size_t i = 0; i < kErrorCount; ++i) {
    if (!errors[i]) continue;
    if (!text.empty()) text += ", ";
    text += kErrorNames[i];
  }
  return text;
}

}  // namespace fci
