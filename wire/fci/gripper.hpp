#pragma once

// The hand's own port. As service.hpp, with a header of 10 bytes and statuses of two.

#include "wire/fci/layout.hpp"

namespace fci::gripper {

inline constexpr std::uint16_t kPort = 1338;
inline constexpr Version kVersion = 3;  // libfranka 0.6 and later

enum class Command : std::uint16_t { kConnect = 0, kHoming = 1, kGrasp = 2, kMove = 3, kStop = 4 };

enum class Status : std::uint16_t { kSuccess = 0, kFail = 1, kUnsuccessful = 2, kAborted = 3 };
enum class ConnectStatus : std::uint16_t { kSuccess = 0, kIncompatibleLibraryVersion = 1 };

struct Header {
  Command command = Command::kConnect;
  std::uint32_t command_id = 0;
  std::uint32_t size = 0;  // bytes of the whole message, header included
};
inline constexpr std::size_t kHeaderSize = 10;

template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, Header>
void walk(V& v, Self& h) {
  v.u16("command", h.command);
  v.u32("command_id", h.command_id);
  v.u32("size", h.size);
}

struct State {
  std::uint32_t message_id = 0;
  double width = 0;      // m
  double max_width = 0;  // m; 0 before homing
  bool is_grasped = false;
  std::uint16_t temperature = 0;  // °C
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, State>
void walk(V& v, Self& s) {
  v.u32("message_id", s.message_id);
  v.f64("width", s.width);
  v.f64("max_width", s.max_width);
  v.u8("is_grasped", s.is_grasped);
  v.u16("temperature", s.temperature);
}
inline constexpr std::size_t kStateSize = 23;

struct Connect {
  static constexpr Command kCommand = Command::kConnect;
  std::uint16_t version = kVersion;
  std::uint16_t udp_port = 0;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, Connect>
void walk(V& v, Self& r) {
  v.u16("version", r.version);
  v.u16("udp_port", r.udp_port);
}

struct ConnectResponse {
  ConnectStatus status = ConnectStatus::kSuccess;
  std::uint16_t version = kVersion;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, ConnectResponse>
void walk(V& v, Self& r) {
  v.u16("status", r.status);
  v.u16("version", r.version);
}

struct Response {
  Status status = Status::kSuccess;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, Response>
void walk(V& v, Self& r) {
  v.u16("status", r.status);
}

struct Homing {
  static constexpr Command kCommand = Command::kHoming;
};
struct Stop {
  static constexpr Command kCommand = Command::kStop;
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, Homing> ||
           std::is_same_v<std::remove_const_t<Self>, Stop>
void walk(V&, Self&) {}

// Succeeds when the fingers stop between width - epsilon_inner and width + epsilon_outer.
struct Grasp {
  static constexpr Command kCommand = Command::kGrasp;
  double width = 0;          // m
  double epsilon_inner = 0;  // m
  double epsilon_outer = 0;  // m
  double speed = 0;          // m/s
  double force = 0;          // N
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, Grasp>
void walk(V& v, Self& r) {
  v.f64("width", r.width);
  v.f64("epsilon.inner", r.epsilon_inner);
  v.f64("epsilon.outer", r.epsilon_outer);
  v.f64("speed", r.speed);
  v.f64("force", r.force);
}

struct Move {
  static constexpr Command kCommand = Command::kMove;
  double width = 0;  // m
  double speed = 0;  // m/s
};
template <class V, class Self>
  requires std::is_same_v<std::remove_const_t<Self>, Move>
void walk(V& v, Self& r) {
  v.f64("width", r.width);
  v.f64("speed", r.speed);
}

}  // namespace fci::gripper
