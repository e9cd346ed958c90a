#include "sim/door/gripper_server.hpp"

#include <sys/socket.h>

#include <array>

namespace sim {
namespace {

using fci::gripper::Command;
using fci::gripper::Status;
namespace wire = fci::gripper;

constexpr fci::Version kAnyVersion = wire::kVersion;  // the hand's messages have one form
constexpr int kCyclesPerState = 16;                   // some 60 Hz; the real rate is not published
constexpr std::array<std::string_view, 5> kNames = {"Connect", "Homing", "Grasp", "Move", "Stop"};

}  // namespace

GripperServer::GripperServer(const in_addr& address, Gripper& gripper, Poller& poller)
    : Port("gripper", address, wire::kPort, wire::kHeaderSize,
           wire::kHeaderSize + fci::size_of<wire::Grasp>(kAnyVersion), poller),
      gripper_(gripper),
      udp_(udp_socket(address, wire::kPort)) {}

Port::Header GripperServer::read_header(std::span<const std::byte> bytes) const {
  wire::Header header;
  fci::read(kAnyVersion, bytes, header);
  return {static_cast<std::uint32_t>(header.command), header.command_id, header.size};
}

bool GripperServer::connect(Connection& newcomer, std::uint32_t id, std::uint16_t version, std::uint16_t udp_port) {
  const bool spoken = version == wire::kVersion;
  if (spoken && !connect_udp(udp_.fd(), newcomer.peer(), udp_port)) return false;
  std::array<std::byte, wire::kHeaderSize + 4> message;
  fci::write(kAnyVersion, wire::Header{Command::kConnect, id, message.size()}, message);
  const auto status = spoken ? wire::ConnectStatus::kSuccess : wire::ConnectStatus::kIncompatibleLibraryVersion;
  fci::write(kAnyVersion, wire::ConnectResponse{status, wire::kVersion}, std::span(message).subspan(wire::kHeaderSize));
  newcomer.send(message);
  if (!spoken) return false;
  cycle_ = 0;
  return true;
}

// What the hand does it does to the end.
void GripperServer::gone() { under_way_.reset(); }

std::string_view GripperServer::request_name(std::uint32_t command) const {
  return command > 0 && command < kNames.size() ? kNames[command] : std::string_view();
}

template <class Request, class Begin>
bool GripperServer::take(std::span<const std::byte> body, Begin&& begin) {
  Request request;
  if (body.size() != fci::size_of<Request>(kAnyVersion)) return false;
  fci::read(kAnyVersion, body, request);
  // A command takes the place of the one under way.
  abort();
  ++commands_;
  begin(request);
  return true;
}

bool GripperServer::handle(const Header& header, std::span<const std::byte> body) {
  const auto command = static_cast<Command>(header.command);
  const std::pair this_one{command, header.id};
  switch (command) {
    case Command::kConnect: return false;
    case Command::kHoming:
      return take<wire::Homing>(body, [&](const auto&) {
        gripper_.home();
        under_way_ = this_one;
      });
    case Command::kGrasp:
      return take<wire::Grasp>(body, [&](const auto& request) {
        gripper_.grasp(request);
        under_way_ = this_one;
      });
    case Command::kMove:
      return take<wire::Move>(body, [&](const auto& request) {
        gripper_.move(request);
        under_way_ = this_one;
      });
    case Command::kStop:
      return take<wire::Stop>(body, [&](const auto&) {
        gripper_.stop();
        answer(command, header.id, Status::kSuccess);
      });
  }
  return false;
}

void GripperServer::answer(Command command, std::uint32_t id, Status status) {
  std::array<std::byte, wire::kHeaderSize + 2> message;
  fci::write(kAnyVersion, wire::Header{command, id, message.size()}, message);
  fci::write(kAnyVersion, wire::Response{status}, std::span(message).subspan(wire::kHeaderSize));
  client().send(message);
}

void GripperServer::abort() {
  if (under_way_) answer(under_way_->first, under_way_->second, Status::kAborted);
  under_way_.reset();
}

void GripperServer::restore(const Moment& moment) {
  if (moment.command != commands_) abort();
  gripper_ = moment.gripper;
}

void GripperServer::publish() {
  if (!connected()) return;
  if (cycle_++ % kCyclesPerState == 0) {
    wire::State state = gripper_.state();
    state.message_id = ++message_id_;
    std::array<std::byte, wire::kStateSize> datagram;
    fci::write(kAnyVersion, state, datagram);
    ::send(udp_.fd(), datagram.data(), datagram.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
  }
  if (under_way_ && gripper_.outcome()) {
    answer(under_way_->first, under_way_->second, *gripper_.outcome());
    under_way_.reset();
  }
}

}  // namespace sim
