#pragma once

#include "wire/fci/robot_state.hpp"

namespace fci {

// The datagram that answers a state. Reals are float64 in every version.
struct RobotCommand {
  std::uint64_t message_id = 0;  // of the newest state seen
  Vector7 q_c{};
  Vector7 dq_c{};
  Pose O_T_EE_c = kIdentityPose;
  Vector6 O_dP_EE_c{};
  std::array<double, 2> elbow_c{};
  bool valid_elbow = false;
  bool motion_generation_finished = false;
  Vector7 tau_J_d{};
  bool torque_command_finished = false;  // version 7 and later
};

inline constexpr Version kTorqueFinishedVersion = 7;

template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, RobotCommand>
void walk(V& v, Self& c) {
  v.u64("message_id", c.message_id);
  v.f64("motion.q_c", c.q_c);
  v.f64("motion.dq_c", c.dq_c);
  v.f64("motion.O_T_EE_c", c.O_T_EE_c);
  v.f64("motion.O_dP_EE_c", c.O_dP_EE_c);
  v.f64("motion.elbow_c", c.elbow_c);
  v.u8("motion.valid_elbow", c.valid_elbow);
  v.u8("motion.motion_generation_finished", c.motion_generation_finished);
  v.f64("control.tau_J_d", c.tau_J_d);
  if (v.version() >= kTorqueFinishedVersion) {
    v.u8("control.torque_command_finished", c.torque_command_finished);
  }
}

inline constexpr std::size_t kMaxCommandSize = 371;  // bytes, of all versions

}  // namespace fci
