#include "server/convert.hpp"

#include <spdlog/fmt/fmt.h>

#include <Eigen/Geometry>

#include "realtime/rotation.hpp"
#include "server/clocks.hpp"
#include "server/registry.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;

template <std::size_t N>
void put(const std::array<double, N>& from, google::protobuf::RepeatedField<double>* to) {
  to->Resize(N, 0);
  std::copy(from.begin(), from.end(), to->begin());
}

template <int Rows, int Columns>
void put(const Eigen::Matrix<double, Rows, Columns>& from, google::protobuf::RepeatedField<double>* to) {
  to->Assign(from.data(), from.data() + from.size());
}

void put(const fci::Errors& from, google::protobuf::RepeatedPtrField<std::string>* to) {
  to->Clear();
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (from[i]) to->Add(std::string(fci::kErrorNames[i]));
  }
}

std::uint32_t convert(realtime::HeldBy held) {
  using realtime::HeldBy;
  static_assert(static_cast<int>(HeldBy::kMotionLimits) == proto::MOTION_LIMITS &&
                static_cast<int>(HeldBy::kTorqueLimits) == proto::TORQUE_LIMITS &&
                static_cast<int>(HeldBy::kJointLimits) == proto::JOINT_LIMITS &&
                static_cast<int>(HeldBy::kWall) == proto::WALL && static_cast<int>(HeldBy::kArm) == proto::HELD_ARM &&
                static_cast<int>(HeldBy::kItself) == proto::ITSELF && static_cast<int>(HeldBy::kToolSpeed) == proto::TOOL_SPEED &&
                static_cast<int>(HeldBy::kPower) == proto::POWER);
  return static_cast<std::uint32_t>(held);
}

proto::RobotMode convert(fci::RobotMode mode) {
  const int value = static_cast<int>(mode);
  return proto::RobotMode_IsValid(value) ? static_cast<proto::RobotMode>(value) : proto::OTHER;
}

void convert(const fci::RobotState& from, proto::RobotState& to) {
  to.set_message_id(from.message_id);
  put(from.O_T_EE, to.mutable_o_t_ee());
  put(from.O_T_EE_d, to.mutable_o_t_ee_d());
  put(from.F_T_EE, to.mutable_f_t_ee());
  put(from.EE_T_K, to.mutable_ee_t_k());
  put(from.F_T_NE, to.mutable_f_t_ne());
  put(from.NE_T_EE, to.mutable_ne_t_ee());
  to.set_m_ee(from.m_ee);
  put(from.I_ee, to.mutable_i_ee());
  put(from.F_x_Cee, to.mutable_f_x_cee());
  to.set_m_load(from.m_load);
  put(from.I_load, to.mutable_i_load());
  put(from.F_x_Cload, to.mutable_f_x_cload());
  put(from.elbow, to.mutable_elbow());
  put(from.elbow_d, to.mutable_elbow_d());
  put(from.tau_J, to.mutable_tau_j());
  put(from.tau_J_d, to.mutable_tau_j_d());
  put(from.dtau_J, to.mutable_dtau_j());
  put(from.q, to.mutable_q());
  put(from.q_d, to.mutable_q_d());
  put(from.dq, to.mutable_dq());
  put(from.dq_d, to.mutable_dq_d());
  put(from.ddq_d, to.mutable_ddq_d());
  put(from.joint_contact, to.mutable_joint_contact());
  put(from.cartesian_contact, to.mutable_cartesian_contact());
  put(from.joint_collision, to.mutable_joint_collision());
  put(from.cartesian_collision, to.mutable_cartesian_collision());
  put(from.tau_ext_hat_filtered, to.mutable_tau_ext_hat_filtered());
  put(from.O_F_ext_hat_K, to.mutable_o_f_ext_hat_k());
  put(from.K_F_ext_hat_K, to.mutable_k_f_ext_hat_k());
  put(from.O_dP_EE_d, to.mutable_o_dp_ee_d());
  put(from.O_ddP_O, to.mutable_o_ddp_o());
  put(from.elbow_c, to.mutable_elbow_c());
  put(from.delbow_c, to.mutable_delbow_c());
  put(from.ddelbow_c, to.mutable_ddelbow_c());
  put(from.O_T_EE_c, to.mutable_o_t_ee_c());
  put(from.O_dP_EE_c, to.mutable_o_dp_ee_c());
  put(from.O_ddP_EE_c, to.mutable_o_ddp_ee_c());
  put(from.theta, to.mutable_theta());
  put(from.dtheta, to.mutable_dtheta());
  put(from.accelerometer_top, to.mutable_accelerometer_top());
  put(from.accelerometer_bottom, to.mutable_accelerometer_bottom());
  to.set_motion_generator_mode(static_cast<std::uint32_t>(from.motion_generator_mode));
  to.set_controller_mode(static_cast<std::uint32_t>(from.controller_mode));
  put(from.errors, to.mutable_errors());
  put(from.reflex_reason, to.mutable_reflex_reason());
  to.set_robot_mode(convert(from.robot_mode));
  to.set_control_command_success_rate(from.control_command_success_rate);
}

void convert(const fci::RobotCommand& from, const fci::RobotState& state, proto::Command& to) {
  using Generator = fci::MotionGeneratorMode;
  switch (state.motion_generator_mode) {
    case Generator::kJointPosition: put(from.q_c, to.mutable_q_c()); break;
    case Generator::kJointVelocity: put(from.dq_c, to.mutable_dq_c()); break;
    case Generator::kCartesianPosition: put(from.O_T_EE_c, to.mutable_o_t_ee_c()); break;
    case Generator::kCartesianVelocity: put(from.O_dP_EE_c, to.mutable_o_dp_ee_c()); break;
    default: break;
  }
  if (state.controller_mode == fci::ControllerMode::kExternal) put(from.tau_J_d, to.mutable_tau_j_d());
  to.set_motion_generation_finished(from.motion_generation_finished);
}

std::string title_of(std::uint16_t part) {
  const auto titles = titles_of_kinds();
  return part == 0 || part > titles.size() ? "a part" : "the " + titles[part - 1];
}

std::string explain(const realtime::PartFault& fault) {
  using Why = realtime::PartFault::Why;
  switch (fault.why) {
    case Why::kNotFinite: return "gave a value that is not finite";
    case Why::kTooLong:
      return fmt::format("takes too long for the 1 kHz loop: the last step took {:.2f} ms, and should take {} ms at most",
                         fault.ns * 1e-6, realtime::PartWatch::kBudget * 1e-6);
    case Why::kAllocates: return "took memory from the heap in the 1 kHz loop, which may wait: take it in the constructor";
    case Why::kNone: break;
  }
  return "is at fault";
}

// Where commands did not come in time: how many, and a long step is worth a word.
std::string late(const realtime::SkillResult& result) {
  if (!result.errors[static_cast<std::size_t>(fci::Error::kCommunicationConstraints)]) return "";
  std::string text = fmt::format(" ({} states were lost, and of the last 100 commands {})", result.lost_states, result.lost_commands);
  if (result.fault.ns < realtime::PartWatch::kVeryLong) return text;
  return text + fmt::format(". One step of {} took {:.0f} ms: was it that?", title_of(result.fault.part), result.fault.ns * 1e-6);
}

std::string explain(const realtime::SkillResult& result) {
  switch (result.ending) {
    case realtime::Ending::kTerminated:
    case realtime::Ending::kPreempted:
    case realtime::Ending::kStopped: return "";
    case realtime::Ending::kRobotError:
      if (result.robot_mode == fci::RobotMode::kUserStopped && !fci::any(result.errors)) {
        return fmt::format("the user stop was pressed after {:.3f} s", result.time);
      }
      if (!fci::any(result.errors)) {
        return fmt::format("the robot ended the motion after {:.3f} s, names no error and is now in mode {}", result.time,
                           proto::RobotMode_Name(convert(result.robot_mode)));
      }
      return fmt::format("the robot stopped after {:.3f} s with {}{}", result.time, fci::names(result.errors), late(result));
    case realtime::Ending::kRefused:
      if (result.status == fci::Status::kFailed) {
        return fmt::format("the robot did not answer {} in time. Nothing has moved", fci::name(result.refused));
      }
      return fmt::format("the robot refused {}: {}. Is it unlocked, FCI activated, and no user stop or error "
                         "pending? Nothing has moved",
                         fci::name(result.refused), fci::name(result.status));
    case realtime::Ending::kConnectionLost:
      return "the connection to the robot was lost: check its network and FCI; the server connects again by itself";
    case realtime::Ending::kCancelled:
      return "it was queued behind a skill that did not end by itself. It has not begun";
    case realtime::Ending::kComponentFault:
      return fmt::format("{} {}. After {:.3f} s the arm was brought to rest without it: this is a defect of that part",
                         title_of(result.fault.part), explain(result.fault), result.time);
  }
  return "";
}

}  // namespace

void convert(const realtime::Reference& goal, proto::SkillStarted& out) {
  if (goal.motion == realtime::Channels::kJoint) {
    put(goal.joint.q, out.mutable_goal_q());
  } else {
    put(realtime::frame(goal.cartesian).matrix(), out.mutable_goal_o_t_ee());
  }
}

proto::Phase convert(realtime::Phase phase) {
  switch (phase) {
    case realtime::Phase::kConnecting: return proto::CONNECTING;
    case realtime::Phase::kIdle: return proto::READY;
    case realtime::Phase::kConfiguring: return proto::CONFIGURING;
    case realtime::Phase::kStarting: return proto::STARTING;
    case realtime::Phase::kRunning: return proto::RUNNING;
    case realtime::Phase::kHolding: return proto::HOLDING;
    case realtime::Phase::kBraking: return proto::BRAKING;
    case realtime::Phase::kFinishing: return proto::FINISHING;
    case realtime::Phase::kError: return proto::ERROR;
    case realtime::Phase::kRecovering: return proto::RECOVERING;
  }
  return proto::CONNECTING;
}

proto::Ending convert(realtime::Ending ending) {
  switch (ending) {
    case realtime::Ending::kTerminated: return proto::TERMINATED;
    case realtime::Ending::kStopped: return proto::STOPPED;
    case realtime::Ending::kPreempted: return proto::PREEMPTED;
    case realtime::Ending::kRobotError: return proto::ROBOT_ERROR;
    case realtime::Ending::kRefused: return proto::REFUSED;
    case realtime::Ending::kConnectionLost: return proto::CONNECTION_LOST;
    case realtime::Ending::kComponentFault: return proto::COMPONENT_FAULT;
    case realtime::Ending::kCancelled: return proto::CANCELLED;
  }
  return proto::ROBOT_ERROR;
}

proto::AfterContact convert(realtime::AfterContact after) {
  switch (after) {
    case realtime::AfterContact::kNoContact: return proto::NO_CONTACT;
    case realtime::AfterContact::kHeld: return proto::HELD;
    case realtime::AfterContact::kComplied: return proto::COMPLIED;
    case realtime::AfterContact::kBackedOff: return proto::BACKED_OFF;
  }
  return proto::NO_CONTACT;
}

void convert(const realtime::Record& record, proto::ArmState& out) {
  convert(record.state, *out.mutable_robot());
  out.set_phase(convert(record.phase));
  out.set_skill_id(record.skill_id);
  out.set_skill_time(record.skill_time);
  out.clear_q_ref();
  out.clear_dq_ref();
  out.clear_o_t_ee_ref();
  out.clear_o_dp_ee_ref();
  out.clear_o_f_ee_ref();
  out.clear_tau_ref();
  const bool commanded = record.command.message_id != 0;
  if (commanded && record.reference.motion == realtime::Channels::kJoint) {
    put(record.reference.joint.q, out.mutable_q_ref());
    put(record.reference.joint.dq, out.mutable_dq_ref());
  } else if (commanded) {
    put(realtime::frame(record.reference.cartesian).matrix(), out.mutable_o_t_ee_ref());
    put(record.reference.cartesian.velocity, out.mutable_o_dp_ee_ref());
  }
  if (commanded && !record.reference.wrench.isZero(0)) put(record.reference.wrench, out.mutable_o_f_ee_ref());
  if (commanded && !record.reference.torque.isZero(0)) put(record.reference.torque, out.mutable_tau_ref());
  out.set_limited(record.held_by != realtime::HeldBy::kNothing);
  out.set_held_by(convert(record.held_by));
  put(record.tau_ext, out.mutable_tau_ext_observed());
  put(record.O_F_ext_K, out.mutable_o_f_ext_observed());
  out.set_collision(record.collision);
  out.set_cycles(record.cycles);
  out.set_lost_states(record.lost_states);
  out.set_compute_us(record.compute_ns * 1e-3);
  out.set_time_ns(since_epoch_ns(record.received_ns));
  out.clear_command();
  if (commanded) convert(record.command, record.state, *out.mutable_command());
}

std::string errors_of(const fci::RobotState& state) {
  if (fci::any(state.errors)) return fci::names(state.errors);
  // The robot keeps the reason of its last reflex.
  const bool reflex = state.robot_mode == fci::RobotMode::kReflex;
  if (reflex && fci::any(state.reflex_reason)) return fci::names(state.reflex_reason);
  switch (state.robot_mode) {
    case fci::RobotMode::kUserStopped: return "user stop is pressed";
    case fci::RobotMode::kGuiding: return "the arm is being guided by hand";
    case fci::RobotMode::kReflex: return "a reflex stopped it";
    case fci::RobotMode::kOther: return "it is locked or its FCI is not active";
    case fci::RobotMode::kIdle: return "the user stop was pressed";  // and released: nothing else holds an idle robot
    default: return "another program moves it";
  }
}

void convert(const realtime::SkillResult& result, proto::SkillResult& out) {
  out.set_skill_id(result.skill_id);
  out.set_ending(convert(result.ending));
  out.set_time(result.time);
  out.set_path_time(result.path_time);
  out.set_lost_states(result.lost_states);
  out.set_lost_commands(result.lost_commands);
  out.set_stretch(result.stretch);
  out.set_limited_cycles(result.limited_cycles);
  out.set_held_by(convert(result.held_by));
  put(result.errors, out.mutable_errors());
  out.set_message(explain(result));
  if (result.first_command_ns != 0) out.set_first_command_ns(result.first_command_ns);
  out.set_last_cycle_ns(result.last_cycle_ns);
  if (result.after_contact != realtime::AfterContact::kNoContact) out.set_after_contact(convert(result.after_contact));
  if (result.after_contact == realtime::AfterContact::kBackedOff) out.set_backed_off(result.backed_off);
  if (result.left.joints) out.set_joints_left(*result.left.joints);
  if (result.left.position) out.set_position_left(*result.left.position);
  if (result.left.angle) out.set_angle_left(*result.left.angle);
}

}  // namespace server
