#include "sim/robot_server.hpp"

#include <spdlog/spdlog.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "sim/model_library/model_library.hpp"

namespace sim {
namespace {

using fci::Command;
using fci::Status;

constexpr int kMaxDatagrams = 64;  // looked at in one cycle

}  // namespace

RobotServer::RobotServer(const models::Arm& arm, const in_addr& address, std::optional<fci::Version> only,
                         Robot& robot, Poller& poller)
    : Port("robot", address, fci::kRobotPort, fci::kHeaderSize, fci::kMaxRequestSize, poller),
      arm_(arm),
      only_(only),
      robot_(robot),
      udp_(udp_socket(address, fci::kRobotPort)) {
  const timeval timeout{0, 1000};  // of wait()
  ::setsockopt(udp_.fd(), SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
}

// --- TCP ------------------------------------------------------------------------------------------------------

Port::Header RobotServer::read_header(std::span<const std::byte> bytes) const {
  fci::Header header;
  fci::read(version_, bytes, header);
  return {header.command, header.command_id, header.size};
}

bool RobotServer::connect(Connection& newcomer, std::uint32_t id, std::uint16_t version, std::uint16_t udp_port) {
  const fci::Version answered =
      only_ ? *only_ : std::clamp<fci::Version>(version, fci::kOldestVersion, fci::kNewestVersion);
  const bool spoken = answered == version;
  const Status status = spoken ? Status::kSuccess : Status::kIncompatibleLibraryVersion;
  std::array<std::byte, fci::kHeaderSize + 3> message;
  fci::write(answered, fci::Header{0, id, message.size()}, message);
  fci::write(answered, fci::ConnectResponse{*fci::status_byte(answered, Command::kConnect, status), answered},
             std::span(message).subspan(fci::kHeaderSize));
  newcomer.send(message);
  if (!spoken) return false;

  version_ = version;
  state_size_ = fci::size_of<fci::RobotState>(version);
  command_size_ = fci::size_of<fci::RobotCommand>(version);
  refused_datagram_ = false;
  robot_.set_version(version);
  // From now on the socket takes datagrams of this client only; what others left in it is dropped.
  sockaddr_in states = newcomer.peer();
  states.sin_port = htons(udp_port);
  ::connect(udp_.fd(), reinterpret_cast<const sockaddr*>(&states), sizeof states);
  std::byte dropped;
  while (::recv(udp_.fd(), &dropped, sizeof dropped, MSG_DONTWAIT) >= 0) {
  }
  return true;
}

void RobotServer::gone() {
  move_.reset();
  stop_.reset();
  recovery_.reset();
  robot_.abandon();
}

std::string_view RobotServer::request_name(std::uint32_t id) const {
  const auto command = fci::command_of(version_, id);
  return command && *command != Command::kConnect ? name(*command) : std::string_view();
}

template <class Request, class Answer>
bool RobotServer::take(const Header& header, std::span<const std::byte> body, Answer&& answer_request) {
  Request request;
  if (body.size() != fci::size_of<Request>(version_)) return false;
  fci::read(version_, body, request);
  answer_request(header.id, request);
  return true;
}

template <class Request>
bool RobotServer::set(const Header& header, std::span<const std::byte> body) {
  return take<Request>(header, body, [&](std::uint32_t id, const Request& request) {
    answer(Request::kCommand, id, robot_.set(request));
  });
}

bool RobotServer::handle(const Header& header, std::span<const std::byte> body) {
  const Command command = *fci::command_of(version_, header.command);
  switch (command) {
    case Command::kConnect: return false;
    case Command::kMove:
      return take<fci::Move>(header, body, [&](std::uint32_t id, const fci::Move& request) {
        const Status status = robot_.start(request);
        if (status == Status::kMotionStarted) move_ = id;
        answer(command, id, status);
      });
    case Command::kStopMove:
      return take<fci::StopMove>(header, body, [&](std::uint32_t id, const fci::StopMove&) {
        if (stop_) return answer(command, id, Status::kNotPossible);
        robot_.stop();
        stop_ = id;
      });
    case Command::kAutomaticErrorRecovery:
      return take<fci::AutomaticErrorRecovery>(
          header, body, [&](std::uint32_t id, const fci::AutomaticErrorRecovery&) {
            const Status status = recovery_ ? Status::kNotPossible : robot_.recover();
            if (status != Status::kSuccess) return answer(command, id, status);
            recovery_ = id;
          });
    case Command::kSetCollisionBehavior: return set<fci::SetCollisionBehavior>(header, body);
    case Command::kSetJointImpedance: return set<fci::SetJointImpedance>(header, body);
    case Command::kSetCartesianImpedance: return set<fci::SetCartesianImpedance>(header, body);
    case Command::kSetGuidingMode: return set<fci::SetGuidingMode>(header, body);
    case Command::kSetEEToK: return set<fci::SetEEToK>(header, body);
    case Command::kSetNEToEE: return set<fci::SetNEToEE>(header, body);
    case Command::kSetLoad: return set<fci::SetLoad>(header, body);
    case Command::kSetFilters: return set<fci::SetFilters>(header, body);
    case Command::kGetCartesianLimit:
      return take<fci::GetCartesianLimit>(header, body, [&](std::uint32_t id, const fci::GetCartesianLimit&) {
        // No virtual walls are set up.
        std::array<std::byte, 154> limit;
        fci::write(version_, fci::GetCartesianLimitResponse{}, limit);
        answer(command, id, Status::kSuccess, std::span(limit).subspan(1));
      });
    case Command::kLoadModelLibrary:
      return take<fci::LoadModelLibrary>(header, body, [&](std::uint32_t id, const fci::LoadModelLibrary& request) {
        const auto library = model_library(arm_.name, request);
        answer(command, id, library.empty() ? Status::kFailed : Status::kSuccess, library);
      });
    case Command::kGetRobotModel:
      return take<fci::GetRobotModel>(header, body, [&](std::uint32_t id, const fci::GetRobotModel&) {
        const std::string urdf = models::urdf(arm_, version_);
        answer(command, id, Status::kSuccess, std::as_bytes(std::span(urdf)));
      });
  }
  return false;
}

void RobotServer::answer(Command command, std::uint32_t id, Status status, std::span<const std::byte> more) {
  std::vector<std::byte> message(fci::kHeaderSize + 1 + more.size());
  const auto size = static_cast<std::uint32_t>(message.size());
  fci::write(version_, fci::Header{*fci::command_id(version_, command), id, size}, message);
  message[fci::kHeaderSize] = static_cast<std::byte>(*fci::status_byte(version_, command, status));
  std::copy(more.begin(), more.end(), message.begin() + fci::kHeaderSize + 1);
  client().send(message);
}

// --- UDP ------------------------------------------------------------------------------------------------------

const fci::RobotCommand* RobotServer::receive() { return receive(MSG_DONTWAIT); }
const fci::RobotCommand* RobotServer::wait() { return receive(0); }

const fci::RobotCommand* RobotServer::receive(int flags) {
  if (!connected()) return nullptr;
  std::array<std::byte, fci::kMaxCommandSize> datagram;
  for (int i = 0; i < kMaxDatagrams; ++i) {
    const ssize_t size = ::recv(udp_.fd(), datagram.data(), datagram.size(), flags | MSG_TRUNC);
    if (size < 0) {
      if (errno == ECONNREFUSED) continue;  // an earlier state found the client's port closed
      return nullptr;
    }
    if (static_cast<std::size_t>(size) == command_size_) {
      fci::Reader reader(version_, datagram.data());
      walk(reader, command_);
      if (robot_.takes(command_)) return &command_;
    } else if (!refused_datagram_) {
      refused_datagram_ = true;
      spdlog::warn("robot: {} sent a datagram of {} bytes, where a command has {}: it is ignored, as will be others",
                   client().name(), size, command_size_);
    }
  }
  return nullptr;
}

void RobotServer::publish() {
  if (!connected()) return;
  std::array<std::byte, fci::kMaxStateSize> datagram;
  fci::Writer writer(version_, datagram.data());
  walk(writer, robot_.state());
  ::send(udp_.fd(), datagram.data(), state_size_, MSG_DONTWAIT | MSG_NOSIGNAL);

  const auto settle = [&](std::optional<std::uint32_t>& id, Command command, Status status) {
    if (id) answer(command, *id, status);
    id.reset();
  };
  if (!robot_.moving()) {
    settle(move_, Command::kMove, robot_.outcome().value_or(Status::kAborted));
    settle(stop_, Command::kStopMove, Status::kSuccess);
  }
  if (!robot_.recovering()) settle(recovery_, Command::kAutomaticErrorRecovery, Status::kSuccess);
}

}  // namespace sim
