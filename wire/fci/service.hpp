#pragma once

// Requests and responses over the arm's TCP port. A message is a Header and a body; a response has
// the command and command_id of its request, and its body starts with a status byte.

#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>

#include "wire/fci/robot_state.hpp"

namespace fci {

inline constexpr std::uint16_t kRobotPort = 1337;

enum class Command : std::uint8_t {
  kConnect,
  kMove,
  kStopMove,
  kGetCartesianLimit,
  kSetCollisionBehavior,
  kSetJointImpedance,
  kSetCartesianImpedance,
  kSetGuidingMode,
  kSetEEToK,
  kSetNEToEE,
  kSetLoad,
  kSetFilters,
  kAutomaticErrorRecovery,
  kLoadModelLibrary,
  kGetRobotModel,
};

inline constexpr std::array<std::string_view, 15> kCommandNames = {
    "Connect", "Move", "StopMove", "GetCartesianLimit", "SetCollisionBehavior",
    "SetJointImpedance", "SetCartesianImpedance", "SetGuidingMode", "SetEEToK", "SetNEToEE",
    "SetLoad", "SetFilters", "AutomaticErrorRecovery", "LoadModelLibrary", "GetRobotModel"};

constexpr std::string_view name(Command command) {
  return kCommandNames[static_cast<std::size_t>(command)];
}

namespace detail {
inline constexpr std::array kCommandsTo5 = {
    Command::kConnect, Command::kMove, Command::kStopMove, Command::kGetCartesianLimit,
    Command::kSetCollisionBehavior, Command::kSetJointImpedance, Command::kSetCartesianImpedance,
    Command::kSetGuidingMode, Command::kSetEEToK, Command::kSetNEToEE, Command::kSetLoad,
    Command::kSetFilters, Command::kAutomaticErrorRecovery, Command::kLoadModelLibrary};
inline constexpr std::array kCommandsTo7 = {
    Command::kConnect, Command::kMove, Command::kStopMove, Command::kSetCollisionBehavior,
    Command::kSetJointImpedance, Command::kSetCartesianImpedance, Command::kSetGuidingMode,
    Command::kSetEEToK, Command::kSetNEToEE, Command::kSetLoad, Command::kAutomaticErrorRecovery,
    Command::kLoadModelLibrary};
inline constexpr std::array kCommandsTo9 = {
    Command::kConnect, Command::kMove, Command::kStopMove, Command::kSetCollisionBehavior,
    Command::kSetJointImpedance, Command::kSetCartesianImpedance, Command::kSetGuidingMode,
    Command::kSetEEToK, Command::kSetNEToEE, Command::kSetLoad, Command::kAutomaticErrorRecovery,
    Command::kLoadModelLibrary, Command::kGetRobotModel};
inline constexpr std::array kCommands10 = {
    Command::kConnect, Command::kMove, Command::kStopMove, Command::kSetCollisionBehavior,
    Command::kSetJointImpedance, Command::kSetCartesianImpedance, Command::kSetGuidingMode,
    Command::kSetEEToK, Command::kSetNEToEE, Command::kSetLoad, Command::kAutomaticErrorRecovery,
    Command::kGetRobotModel};
}  // namespace detail

// The commands of a version; a command's id on the wire is its index.
constexpr std::span<const Command> commands(Version version) {
  if (version <= 5) return detail::kCommandsTo5;
  if (version <= 7) return detail::kCommandsTo7;
  if (version <= 9) return detail::kCommandsTo9;
  return detail::kCommands10;
}

constexpr std::optional<std::uint32_t> command_id(Version version, Command command) {
  const auto all = commands(version);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i] == command) return static_cast<std::uint32_t>(i);
  }
  return std::nullopt;
}

constexpr std::optional<Command> command_of(Version version, std::uint32_t id) {
  const auto all = commands(version);
  if (id >= all.size()) return std::nullopt;
  return all[id];
}

enum class Status : std::uint8_t {
  kSuccess,
  kMotionStarted,
  kPreempted,
  kPreemptedDueToActivatedSafetyFunctions,
  kRejectedDueToActivatedSafetyFunctions,
  kNotPossible,
  kStartAtSingularPose,
  kInvalidArgument,
  kReflexAborted,
  kEmergencyAborted,
  kInputErrorAborted,
  kAborted,
  kManualErrorRecoveryRequired,
  kIncompatibleLibraryVersion,
  kFailed,
};

inline constexpr std::array<std::string_view, 15> kStatusNames = {
    "success", "motion started", "preempted", "preempted: a safety function is active",
    "rejected: a safety function is active", "not possible in the robot's current mode",
    "start at a singular pose", "invalid argument", "aborted by a reflex",
    "aborted by the emergency stop", "aborted: input error", "aborted",
    "manual error recovery required", "incompatible library version", "failed"};

constexpr std::string_view name(Status status) {
  return kStatusNames[static_cast<std::size_t>(status)];
}

namespace detail {
inline constexpr std::array kMoveTo5 = {
    Status::kSuccess, Status::kMotionStarted, Status::kPreempted, Status::kNotPossible,
    Status::kStartAtSingularPose, Status::kInvalidArgument, Status::kReflexAborted,
    Status::kEmergencyAborted, Status::kInputErrorAborted, Status::kAborted};
inline constexpr std::array kMoveFrom6 = {
    Status::kSuccess, Status::kMotionStarted, Status::kPreempted,
    Status::kPreemptedDueToActivatedSafetyFunctions, Status::kRejectedDueToActivatedSafetyFunctions,
    Status::kNotPossible, Status::kStartAtSingularPose, Status::kInvalidArgument,
    Status::kReflexAborted, Status::kEmergencyAborted, Status::kInputErrorAborted, Status::kAborted};
inline constexpr std::array kStopTo5 = {Status::kSuccess, Status::kNotPossible,
                                        Status::kEmergencyAborted, Status::kReflexAborted,
                                        Status::kAborted};
inline constexpr std::array kStopFrom6 = {Status::kSuccess, Status::kNotPossible,
                                          Status::kRejectedDueToActivatedSafetyFunctions,
                                          Status::kEmergencyAborted, Status::kReflexAborted,
                                          Status::kAborted};
inline constexpr std::array kRecoveryTo5 = {
    Status::kSuccess, Status::kNotPossible, Status::kManualErrorRecoveryRequired,
    Status::kReflexAborted, Status::kEmergencyAborted, Status::kAborted};
inline constexpr std::array kRecoveryFrom6 = {
    Status::kSuccess, Status::kNotPossible, Status::kRejectedDueToActivatedSafetyFunctions,
    Status::kManualErrorRecoveryRequired, Status::kReflexAborted, Status::kEmergencyAborted,
    Status::kAborted};
inline constexpr std::array kSetterTo5 = {Status::kSuccess, Status::kNotPossible,
                                          Status::kInvalidArgument};
inline constexpr std::array kSetterFrom6 = {Status::kSuccess, Status::kNotPossible,
                                            Status::kInvalidArgument,
                                            Status::kRejectedDueToActivatedSafetyFunctions};
inline constexpr std::array kConnectStatus = {Status::kSuccess, Status::kIncompatibleLibraryVersion};
inline constexpr std::array kDownloadStatus = {Status::kSuccess, Status::kFailed};
}  // namespace detail

// The statuses that answer a command; a status' byte on the wire is its index.
constexpr std::span<const Status> statuses(Version version, Command command) {
  const bool to5 = version <= 5;
  switch (command) {
    case Command::kConnect: return detail::kConnectStatus;
    case Command::kMove: return to5 ? std::span<const Status>(detail::kMoveTo5) : detail::kMoveFrom6;
    case Command::kStopMove:
      return to5 ? std::span<const Status>(detail::kStopTo5) : detail::kStopFrom6;
    case Command::kAutomaticErrorRecovery:
      return to5 ? std::span<const Status>(detail::kRecoveryTo5) : detail::kRecoveryFrom6;
    case Command::kLoadModelLibrary:
    case Command::kGetRobotModel: return detail::kDownloadStatus;
    default: return to5 ? std::span<const Status>(detail::kSetterTo5) : detail::kSetterFrom6;
  }
}

constexpr std::optional<std::uint8_t> status_byte(Version version, Command command, Status status) {
  const auto all = statuses(version, command);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i] == status) return static_cast<std::uint8_t>(i);
  }
  return std::nullopt;
}

constexpr std::optional<Status> status_of(Version version, Command command, std::uint8_t byte) {
  const auto all = statuses(version, command);
  if (byte >= all.size()) return std::nullopt;
  return all[byte];
}

struct Header {
  std::uint32_t command = 0;     // command_id(version, ...)
  std::uint32_t command_id = 0;  // the client's counter
  std::uint32_t size = 0;        // bytes of the whole message, header included
};
inline constexpr std::size_t kHeaderSize = 12;

template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, Header>
void walk(V& v, Self& h) {
  v.u32("command", h.command);
  v.u32("command_id", h.command_id);
  v.u32("size", h.size);
}

struct Connect {
  static constexpr Command kCommand = Command::kConnect;
  std::uint16_t version = 0;   // of the client
  std::uint16_t udp_port = 0;  // where the client wants its states
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, Connect>
void walk(V& v, Self& r) {
  v.u16("version", r.version);
  v.u16("udp_port", r.udp_port);
}

struct ConnectResponse {
  std::uint8_t status = 0;
  std::uint16_t version = 0;  // of the arm
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, ConnectResponse>
void walk(V& v, Self& r) {
  v.u8("status", r.status);
  v.u16("version", r.version);
}

// How far the robot may be from path and goal before it raises an error; these are the values that
// libfranka always sends.
struct Deviation {
  double translation = 10;                 // m
  double rotation = 3.12;                  // rad
  double elbow = 2 * std::numbers::pi;     // rad
};

struct Move {
  static constexpr Command kCommand = Command::kMove;
  ControllerMode controller_mode = ControllerMode::kJointImpedance;
  MotionGeneratorMode motion_generator_mode = MotionGeneratorMode::kJointPosition;
  Deviation maximum_path_deviation = {};
  Deviation maximum_goal_pose_deviation = {};
  bool use_async_motion_generator = false;  // version 10
  Vector7 maximum_velocity{};               // rad/s; version 10, for the asynchronous generator
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, Move>
void walk(V& v, Self& r) {
  // A request counts its motion generators from joint position, the state from idle.
  auto generator = static_cast<std::uint32_t>(r.motion_generator_mode) - 1;
  auto controller = static_cast<std::uint32_t>(r.controller_mode);
  v.u32("controller_mode", controller);
  v.u32("motion_generator_mode", generator);
  if constexpr (!std::is_const_v<Self>) {
    // What is out of range becomes a value that no mode has, for the receiver to refuse.
    r.controller_mode = static_cast<ControllerMode>(controller > 2 ? 255 : controller);
    r.motion_generator_mode =
        static_cast<MotionGeneratorMode>(generator > 4 ? 255 : generator + 1);
  }
  v.f64("maximum_path_deviation.translation", r.maximum_path_deviation.translation);
  v.f64("maximum_path_deviation.rotation", r.maximum_path_deviation.rotation);
  v.f64("maximum_path_deviation.elbow", r.maximum_path_deviation.elbow);
  v.f64("maximum_goal_pose_deviation.translation", r.maximum_goal_pose_deviation.translation);
  v.f64("maximum_goal_pose_deviation.rotation", r.maximum_goal_pose_deviation.rotation);
  v.f64("maximum_goal_pose_deviation.elbow", r.maximum_goal_pose_deviation.elbow);
  if (v.version() >= 10) {
    v.u8("use_async_motion_generator", r.use_async_motion_generator);
    v.f64("maximum_velocity", r.maximum_velocity);
  }
}

struct StopMove {
  static constexpr Command kCommand = Command::kStopMove;
};
struct AutomaticErrorRecovery {
  static constexpr Command kCommand = Command::kAutomaticErrorRecovery;
};
struct GetRobotModel {
  static constexpr Command kCommand = Command::kGetRobotModel;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, StopMove> ||
           std::is_same_v<std::remove_const_t<Self>, AutomaticErrorRecovery> ||
           std::is_same_v<std::remove_const_t<Self>, GetRobotModel>
void walk(V&, Self&) {}

// Contact above the lower thresholds, reflex above the upper ones; N m and N.
struct SetCollisionBehavior {
  static constexpr Command kCommand = Command::kSetCollisionBehavior;
  Vector7 lower_torque_thresholds_acceleration{};
  Vector7 upper_torque_thresholds_acceleration{};
  Vector7 lower_torque_thresholds_nominal{};
  Vector7 upper_torque_thresholds_nominal{};
  Vector6 lower_force_thresholds_acceleration{};
  Vector6 upper_force_thresholds_acceleration{};
  Vector6 lower_force_thresholds_nominal{};
  Vector6 upper_force_thresholds_nominal{};
  bool operator==(const SetCollisionBehavior&) const = default;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, SetCollisionBehavior>
void walk(V& v, Self& r) {
  v.f64("lower_torque_thresholds_acceleration", r.lower_torque_thresholds_acceleration);
  v.f64("upper_torque_thresholds_acceleration", r.upper_torque_thresholds_acceleration);
  v.f64("lower_torque_thresholds_nominal", r.lower_torque_thresholds_nominal);
  v.f64("upper_torque_thresholds_nominal", r.upper_torque_thresholds_nominal);
  v.f64("lower_force_thresholds_acceleration", r.lower_force_thresholds_acceleration);
  v.f64("upper_force_thresholds_acceleration", r.upper_force_thresholds_acceleration);
  v.f64("lower_force_thresholds_nominal", r.lower_force_thresholds_nominal);
  v.f64("upper_force_thresholds_nominal", r.upper_force_thresholds_nominal);
}

struct SetJointImpedance {
  static constexpr Command kCommand = Command::kSetJointImpedance;
  Vector7 K_theta{};  // N m/rad, 0 to 14250
  bool operator==(const SetJointImpedance&) const = default;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, SetJointImpedance>
void walk(V& v, Self& r) {
  v.f64("K_theta", r.K_theta);
}

struct SetCartesianImpedance {
  static constexpr Command kCommand = Command::kSetCartesianImpedance;
  Vector6 K_x{};  // N/m, 10 to 3000; N m/rad, 1 to 300
  bool operator==(const SetCartesianImpedance&) const = default;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, SetCartesianImpedance>
void walk(V& v, Self& r) {
  v.f64("K_x", r.K_x);
}

struct SetGuidingMode {
  static constexpr Command kCommand = Command::kSetGuidingMode;
  std::array<bool, 6> guiding_mode{};
  bool nullspace = false;
  bool operator==(const SetGuidingMode&) const = default;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, SetGuidingMode>
void walk(V& v, Self& r) {
  v.u8("guiding_mode", r.guiding_mode);
  v.u8("nullspace", r.nullspace);
}

struct SetEEToK {
  static constexpr Command kCommand = Command::kSetEEToK;
  Pose EE_T_K = kIdentityPose;
  bool operator==(const SetEEToK&) const = default;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, SetEEToK>
void walk(V& v, Self& r) {
  v.f64("EE_T_K", r.EE_T_K);
}

struct SetNEToEE {
  static constexpr Command kCommand = Command::kSetNEToEE;
  Pose NE_T_EE = kIdentityPose;
  bool operator==(const SetNEToEE&) const = default;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, SetNEToEE>
void walk(V& v, Self& r) {
  v.f64("NE_T_EE", r.NE_T_EE);
}

struct SetLoad {
  static constexpr Command kCommand = Command::kSetLoad;
  double m_load = 0;      // kg
  Vector3 F_x_Cload{};    // m, in the flange frame
  Matrix3 I_load{};       // kg m², about the load's centre of mass
  bool operator==(const SetLoad&) const = default;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, SetLoad>
void walk(V& v, Self& r) {
  v.f64("m_load", r.m_load);
  v.f64("F_x_Cload", r.F_x_Cload);
  v.f64("I_load", r.I_load);
}

// Up to version 5.
struct GetCartesianLimit {
  static constexpr Command kCommand = Command::kGetCartesianLimit;
  std::int32_t id = 0;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, GetCartesianLimit>
void walk(V& v, Self& r) {
  v.u32("id", r.id);
}

struct GetCartesianLimitResponse {
  std::uint8_t status = 0;
  Vector3 object_world_size{};  // m
  Pose object_frame = kIdentityPose;
  bool object_activation = false;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, GetCartesianLimitResponse>
void walk(V& v, Self& r) {
  v.u8("status", r.status);
  v.f64("object_world_size", r.object_world_size);
  v.f64("object_frame", r.object_frame);
  v.u8("object_activation", r.object_activation);
}

// Up to version 5; Hz.
struct SetFilters {
  static constexpr Command kCommand = Command::kSetFilters;
  double joint_position_filter_frequency = 1000;
  double joint_velocity_filter_frequency = 1000;
  double cartesian_position_filter_frequency = 1000;
  double cartesian_velocity_filter_frequency = 1000;
  double controller_filter_frequency = 1000;
  bool operator==(const SetFilters&) const = default;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, SetFilters>
void walk(V& v, Self& r) {
  v.f64("joint_position_filter_frequency", r.joint_position_filter_frequency);
  v.f64("joint_velocity_filter_frequency", r.joint_velocity_filter_frequency);
  v.f64("cartesian_position_filter_frequency", r.cartesian_position_filter_frequency);
  v.f64("cartesian_velocity_filter_frequency", r.cartesian_velocity_filter_frequency);
  v.f64("controller_filter_frequency", r.controller_filter_frequency);
}

// Versions 3 to 9. The response is a status byte and the bytes of a shared library.
struct LoadModelLibrary {
  static constexpr Command kCommand = Command::kLoadModelLibrary;
  std::uint8_t architecture = 0;  // 0 x64, 1 x86, 2 ARM, 3 ARM64
  std::uint8_t system = 0;        // 0 Linux, 1 Windows
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, LoadModelLibrary>
void walk(V& v, Self& r) {
  v.u8("architecture", r.architecture);
  v.u8("system", r.system);
}

inline constexpr std::size_t kMaxRequestSize = kHeaderSize + 416;  // SetCollisionBehavior

// Writes header and body of a request; returns its bytes, or 0 when this version has no such command.
template <class Request>
std::size_t write_request(Version version, std::uint32_t id, const Request& request,
                          std::span<std::byte, kMaxRequestSize> out) {
  const auto command = command_id(version, Request::kCommand);
  if (!command) return 0;
  const std::size_t size = kHeaderSize + size_of<Request>(version);
  write(version, Header{*command, id, static_cast<std::uint32_t>(size)}, out);
  write(version, request, out.subspan(kHeaderSize));
  return size;
}

}  // namespace fci
