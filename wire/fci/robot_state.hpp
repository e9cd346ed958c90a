#pragma once

#include "wire/fci/errors.hpp"
#include "wire/fci/layout.hpp"

namespace fci {

using Vector3 = std::array<double, 3>;
using Vector6 = std::array<double, 6>;
using Vector7 = std::array<double, 7>;
using Matrix3 = std::array<double, 9>;   // column-major
using Pose = std::array<double, 16>;     // homogeneous transform, column-major

inline constexpr Pose kIdentityPose = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

// Which reference the arm takes. The numbers are those of the state; a Move request counts from
// kJointPosition = 0 (see service.hpp).
enum class MotionGeneratorMode : std::uint8_t {
  kIdle = 0,
  kJointPosition = 1,
  kJointVelocity = 2,
  kCartesianPosition = 3,
  kCartesianVelocity = 4,
  kNone = 5,  // version 7 and later: torque alone
};

enum class ControllerMode : std::uint8_t {
  kJointImpedance = 0,
  kCartesianImpedance = 1,
  kExternal = 2,
  kOther = 3,
};

enum class RobotMode : std::uint8_t {
  kOther = 0,
  kIdle = 1,
  kMove = 2,
  kGuiding = 3,
  kReflex = 4,
  kUserStopped = 5,
  kAutomaticErrorRecovery = 6,
};

// The datagram that an arm sends each cycle. Symbols and frames as in libfranka's RobotState:
// O base, F flange, NE nominal end effector, EE end effector, K stiffness frame; SI units.
struct RobotState {
  std::uint64_t message_id = 0;  // ms since the arm started, strictly increasing
  Pose O_T_EE = kIdentityPose;
  Pose O_T_EE_d = kIdentityPose;
  Pose F_T_EE = kIdentityPose;
  Pose EE_T_K = kIdentityPose;
  Pose F_T_NE = kIdentityPose;
  Pose NE_T_EE = kIdentityPose;
  double m_ee = 0;
  Matrix3 I_ee{};
  Vector3 F_x_Cee{};
  double m_load = 0;
  Matrix3 I_load{};
  Vector3 F_x_Cload{};
  std::array<double, 2> elbow{};    // q3 in rad, sign of the fourth joint (-1 or +1)
  std::array<double, 2> elbow_d{};
  Vector7 tau_J{};    // link-side torque sensors, gravity included
  Vector7 tau_J_d{};  // desired, without gravity and friction
  Vector7 dtau_J{};
  Vector7 q{};
  Vector7 q_d{};
  Vector7 dq{};
  Vector7 dq_d{};
  Vector7 ddq_d{};
  Vector7 joint_contact{};  // level per joint, 0 when below the lower threshold
  Vector6 cartesian_contact{};
  Vector7 joint_collision{};
  Vector6 cartesian_collision{};
  Vector7 tau_ext_hat_filtered{};
  Vector6 O_F_ext_hat_K{};
  Vector6 K_F_ext_hat_K{};
  Vector6 O_dP_EE_d{};
  Vector3 O_ddP_O{};  // base acceleration, gravity's reaction: (0, 0, -9.81) for an upright arm
  std::array<double, 2> elbow_c{};
  std::array<double, 2> delbow_c{};
  std::array<double, 2> ddelbow_c{};
  Pose O_T_EE_c = kIdentityPose;
  Vector6 O_dP_EE_c{};
  Vector6 O_ddP_EE_c{};
  Vector7 theta{};  // motor positions behind the gears
  Vector7 dtheta{};
  std::array<double, 18> accelerometer_top{};  // version 10: six sensors, three axes
  std::array<double, 18> accelerometer_bottom{};
  MotionGeneratorMode motion_generator_mode = MotionGeneratorMode::kIdle;
  ControllerMode controller_mode = ControllerMode::kJointImpedance;
  Errors errors{};
  Errors reflex_reason{};
  RobotMode robot_mode = RobotMode::kIdle;
  double control_command_success_rate = 0;  // share of the last 100 commands, 0..1; 0 without a motion
};

template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, RobotState>
void walk(V& v, Self& s) {
  v.u64("message_id", s.message_id);
  v.real("O_T_EE", s.O_T_EE);
  v.real("O_T_EE_d", s.O_T_EE_d);
  v.real("F_T_EE", s.F_T_EE);
  v.real("EE_T_K", s.EE_T_K);
  v.real("F_T_NE", s.F_T_NE);
  v.real("NE_T_EE", s.NE_T_EE);
  v.real("m_ee", s.m_ee);
  v.real("I_ee", s.I_ee);
  v.real("F_x_Cee", s.F_x_Cee);
  v.real("m_load", s.m_load);
  v.real("I_load", s.I_load);
  v.real("F_x_Cload", s.F_x_Cload);
  v.real("elbow", s.elbow);
  v.real("elbow_d", s.elbow_d);
  v.real("tau_J", s.tau_J);
  v.real("tau_J_d", s.tau_J_d);
  v.real("dtau_J", s.dtau_J);
  v.real("q", s.q);
  v.real("q_d", s.q_d);
  v.real("dq", s.dq);
  v.real("dq_d", s.dq_d);
  v.real("ddq_d", s.ddq_d);
  v.real("joint_contact", s.joint_contact);
  v.real("cartesian_contact", s.cartesian_contact);
  v.real("joint_collision", s.joint_collision);
  v.real("cartesian_collision", s.cartesian_collision);
  v.real("tau_ext_hat_filtered", s.tau_ext_hat_filtered);
  v.real("O_F_ext_hat_K", s.O_F_ext_hat_K);
  v.real("K_F_ext_hat_K", s.K_F_ext_hat_K);
  v.real("O_dP_EE_d", s.O_dP_EE_d);
  v.real("O_ddP_O", s.O_ddP_O);
  v.real("elbow_c", s.elbow_c);
  v.real("delbow_c", s.delbow_c);
  v.real("ddelbow_c", s.ddelbow_c);
  v.real("O_T_EE_c", s.O_T_EE_c);
  v.real("O_dP_EE_c", s.O_dP_EE_c);
  v.real("O_ddP_EE_c", s.O_ddP_EE_c);
  v.real("theta", s.theta);
  v.real("dtheta", s.dtheta);
  if (v.version() >= kFloatStateVersion) {
    v.real("accelerometer_top", s.accelerometer_top);
    v.real("accelerometer_bottom", s.accelerometer_bottom);
  }
  v.u8("motion_generator_mode", s.motion_generator_mode);
  v.u8("controller_mode", s.controller_mode);
  v.u8("errors", s.errors);
  v.u8("reflex_reason", s.reflex_reason);
  v.u8("robot_mode", s.robot_mode);
  v.real("control_command_success_rate", s.control_command_success_rate);
}

inline constexpr std::size_t kMaxStateSize = 2373;  // bytes, of all versions

}  // namespace fci
