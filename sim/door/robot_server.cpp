#include "sim/door/robot_server.hpp"

#include <spdlog/spdlog.h>
#include <linux/sockios.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <ctime>
#include <memory>

#include "sim/clock.hpp"
#include "sim/model_library/model_library.hpp"

namespace sim {
namespace {

using fci::Command;
using fci::Status;

constexpr int kMaxDatagrams = 64;  // looked at in one cycle
constexpr std::int64_t kCycle = 1'000'000;  // ns of the robot's time

}  // namespace

RobotServer::RobotServer(const models::Arm& arm, const in_addr& address, std::optional<fci::Version> only,
                         const std::string& wire, Robot& robot, Poller& poller)
    : Port("robot", address, fci::kRobotPort, fci::kHeaderSize, fci::kMaxRequestSize, poller),
      arm_(arm),
      only_(only),
      robot_(robot),
      clock_(poller.clock()),
      udp_(udp_socket(address, fci::kRobotPort)) {
  if (!wire.empty()) wire_.emplace(wire, address);
}

// --- TCP ------------------------------------------------------------------------------------------------------

Port::Header RobotServer::read_header(std::span<const std::byte> bytes) const {
  fci::Header header;
  fci::read(version_, bytes, header);
  return {header.command, header.command_id, header.size};
}

bool RobotServer::connect(Connection& newcomer, std::uint32_t id, std::uint16_t version, std::uint16_t udp_port) {
  const fci::Version answered = only_ ? *only_ : std::clamp(version, arm_.oldest_version, arm_.newest_version);
  const bool spoken = answered == version;
  if (spoken && !connect_udp(udp_.fd(), newcomer.peer(), udp_port)) return false;
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
  sent_.clear();
  robot_.set_version(version);
  sockaddr_in states = newcomer.peer();
  states.sin_port = htons(udp_port);
  if (wire_) wire_->set_client(states);
  drop_datagrams();  // that others have left in the socket
  return true;
}

void RobotServer::drop_datagrams() {
  std::byte dropped;
  while (::recv(udp_.fd(), &dropped, sizeof dropped, MSG_DONTWAIT) >= 0) {
  }
}

void RobotServer::gone() {
  delayed_states_.clear();
  delayed_commands_.clear();
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
        if (status == Status::kMotionStarted) {
          move_ = id;
          ++motions_;
        }
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
      return take<fci::GetCartesianLimit>(header, body, [&](std::uint32_t id, const fci::GetCartesianLimit& request) {
        const VirtualWall wall = robot_.virtual_wall(request.id);
        fci::GetCartesianLimitResponse response;
        Eigen::Vector3d::Map(response.object_world_size.data()) = wall.size;
        Eigen::Matrix4d::Map(response.object_frame.data()) = wall.frame.matrix();
        response.object_activation = wall.active;
        std::array<std::byte, 154> limit;
        fci::write(version_, response, limit);
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

const fci::RobotCommand* RobotServer::wait(std::int64_t until) {
  if (const auto* command = receive()) return command;
  clock_.wait_for(udp_.fd(), std::min(until, clock_.now() + kCycle));
  return receive();
}

const fci::RobotCommand* RobotServer::receive() {
  if (!connected()) return nullptr;
  while (!delayed_commands_.empty()) {
    const DelayedCommand& first = delayed_commands_.front();
    if (first.due > network_time()) break;
    const auto* command = take(first.what);
    delayed_commands_.erase(delayed_commands_.begin());
    if (command) return command;
  }
  std::array<std::byte, fci::kMaxCommandSize> datagram;
  const fci::RobotCommand* newest = nullptr;
  for (int i = 0; i < kMaxDatagrams && !in_vain_; ++i) {
    const ssize_t size = ::recv(udp_.fd(), datagram.data(), datagram.size(), MSG_DONTWAIT | MSG_TRUNC);
    if (size < 0) {
      if (errno == ECONNREFUSED) continue;  // an earlier state found the client's port closed
      return newest;
    }
    if (wire_) wire_->received(std::span(datagram).first(std::min<std::size_t>(size, datagram.size())), size);
    if (static_cast<std::size_t>(size) == command_size_) {
      fci::RobotCommand command;
      fci::Reader reader(version_, datagram.data());
      walk(reader, command);
      // What would not count anyway costs no draw: when it comes depends on the computer.
      if (robot_.expects(command) && held_up(command)) continue;
      if (const auto* taken = take(command)) {
        if (!robot_.asynchronous()) return taken;
        newest = taken;
      }
    } else if (!refused_datagram_) {
      refused_datagram_ = true;
      spdlog::warn("robot: {} sent a datagram of {} bytes, where a command has {}: it is ignored, as will be others",
                   client().name(), size, command_size_);
    }
  }
  return newest;
}

const fci::RobotCommand* RobotServer::take(const fci::RobotCommand& command) {
  if (!robot_.takes(command)) return nullptr;
  command_ = command;
  return &command_;
}

// When the datagram came that was received last, by the kernel, or now.
std::int64_t RobotServer::arrival() const {
  timespec came, now;
  const std::int64_t time = clock_.now();
  if (::ioctl(udp_.fd(), SIOCGSTAMPNS_OLD, &came) != 0) return time;  // which asks the kernel to note it from now on
  ::clock_gettime(CLOCK_REALTIME, &now);
  return time - ((now.tv_sec - came.tv_sec) * 1'000'000'000 + now.tv_nsec - came.tv_nsec);
}

// By which what is delayed is due: ns, or message_id.
std::int64_t RobotServer::network_time() const {
  return period_ > 0 ? clock_.now() : static_cast<std::int64_t>(robot_.state().message_id);
}

// Whether the network keeps back this command, for a time or for good.
bool RobotServer::held_up(const fci::RobotCommand& command) {
  const auto delay = network_.to_arm();
  if (delay && (*delay == 0 || (period_ == 0 && *delay < kCycle))) return false;
  if (!delay) {
    in_vain_ = period_ == 0;
    return true;
  }
  std::int64_t due;
  if (period_ > 0) {
    due = arrival() + *delay * period_ / kCycle;
    if (due <= clock_.now()) return false;
  } else {
    in_vain_ = true;
    due = network_time() + *delay / kCycle;
  }
  delayed_commands_.push_back({due, command});
  return true;
}

void RobotServer::send_delayed(std::int64_t now) {
  std::erase_if(delayed_states_, [&](const DelayedState& state) {
    if (state.due > now) return false;
    send(state.what);
    return true;
  });
}

std::optional<std::int64_t> RobotServer::next_delayed() const {
  std::optional<std::int64_t> next;
  for (const DelayedState& state : delayed_states_) next = std::min(next.value_or(state.due), state.due);
  return next;
}

void RobotServer::publish(std::int64_t period) {
  period_ = period;
  in_vain_ = false;
  if (!connected()) return;
  const auto delay = robot_.moving() ? network_.from_arm() : 0;
  if (delay && (*delay == 0 || (period == 0 && *delay < kCycle))) {
    send_state();
  } else {
    in_vain_ = period == 0;
    if (delay) {
      const std::int64_t due = network_time() + (period > 0 ? *delay * period / kCycle : *delay / kCycle);
      write_state(delayed_states_.emplace_back(due, std::vector<std::byte>{}).what);
    }
  }
  if (period == 0 && !delayed_states_.empty()) send_delayed(network_time());
  settle();
}

void RobotServer::repeat() {
  if (!connected()) return;
  if (sent_.empty()) write_state(sent_);
  send(sent_);
  settle();
}

void RobotServer::write_state(std::vector<std::byte>& datagram) const {
  datagram.resize(state_size_);
  fci::Writer writer(version_, datagram.data());
  walk(writer, robot_.state());
}

void RobotServer::send_state() {
  write_state(sent_);
  send(sent_);
}

void RobotServer::send(std::span<const std::byte> state) {
  if (wire_) wire_->sent(state);
  ::send(udp_.fd(), state.data(), state.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
}

// Answers that the robot's state makes true.
void RobotServer::settle() {
  const auto settle = [&](std::optional<std::uint32_t>& id, Command command, Status status) {
    if (id) answer(command, *id, status);
    id.reset();
  };
  if (!robot_.moving()) {
    const Status outcome = robot_.outcome().value_or(Status::kAborted);
    // Something else may have stopped the arm before it was at rest.
    const bool stopped = !move_ || outcome == Status::kPreempted || outcome == Status::kSuccess;
    const Status instead = outcome == Status::kPreemptedDueToActivatedSafetyFunctions ? Status::kRejectedDueToActivatedSafetyFunctions : outcome;
    settle(move_, Command::kMove, outcome);
    settle(stop_, Command::kStopMove,
           stopped || !fci::status_byte(version_, Command::kStopMove, instead) ? Status::kSuccess : instead);
  }
  if (!robot_.recovering()) settle(recovery_, Command::kAutomaticErrorRecovery, robot_.recovered());
}

// --- moments --------------------------------------------------------------------------------------------------

void RobotServer::require_settled(const char* wish) const {
  if (!stop_ && !recovery_ && move_.has_value() == robot_.moving()) return;
  throw std::runtime_error(std::string("a motion is being stopped or an error recovered from: a moment can be ") + wish +
                           " when that is over");
}

RobotServer::Moment RobotServer::save() const {
  require_settled("saved");
  Moment moment{robot_, move_ ? motions_ : 0, network_, in_vain_, delayed_states_, delayed_commands_};
  const std::int64_t now = network_time();
  for (auto& state : moment.delayed_states) state.due -= now;
  for (auto& command : moment.delayed_commands) command.due -= now;
  return moment;
}

void RobotServer::require_restorable(const Moment& moment) const {
  require_settled("restored");
  const std::uint64_t motion = move_ ? motions_ : 0;
  if (motion == moment.motion) return;
  throw std::runtime_error(moment.motion == 0
                               ? "a motion runs, and its client would go on with it: end it before a moment is restored "
                                 "that was saved while none ran"
                               : "that moment was saved within a motion which no longer runs, and its client is not taken "
                                 "back with the arm: restore it while that motion runs, or save moments while none runs");
}

void RobotServer::restore(const Moment& moment) {
  const std::uint64_t id = robot_.state().message_id;
  const Settings settings = robot_.settings();
  std::destroy_at(&robot_);
  std::construct_at(&robot_, moment.robot);
  robot_.continue_from(id);
  robot_.set_version(version_);
  robot_.keep(settings);
  network_ = moment.network;
  in_vain_ = moment.in_vain;
  if (moment.motion != 0) {
    robot_.continue_from(id + 1);
    drop_datagrams();
    if (!in_vain_) send_state();
  }
  const std::int64_t now = network_time();
  delayed_states_ = moment.delayed_states;
  delayed_commands_ = moment.delayed_commands;
  for (auto& state : delayed_states_) state.due += now;
  for (auto& command : delayed_commands_) command.due += now;
}

}  // namespace sim
