#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "driven_arm.hpp"
#include "thresholds.hpp"
#include "wire/fci/gripper.hpp"
#include "wire/fci/robot_command.hpp"
#include "wire/fci/service.hpp"

namespace testing_tools {

// Of torques alone.
constexpr fci::Move kTorque{.controller_mode = fci::ControllerMode::kExternal, .motion_generator_mode = fci::MotionGeneratorMode::kNone};

using Bytes = std::vector<std::byte>;

// Sockets to one port of an arm, and bytes. Who waits for an arm that is driven runs its cycles meanwhile. A call that
// waits gives up after some seconds, or cycles, by throwing.
class RawSockets {
 public:
  RawSockets(DrivenArm& arm, std::uint16_t port) : RawSockets(arm.address(), port) {
    driven_ = &arm;
    states_ = port == fci::kRobotPort;
  }
  RawSockets(const std::string& address, std::uint16_t port) {
    sockaddr_in arm{};
    arm.sin_family = AF_INET;
    arm.sin_port = htons(port);
    ::inet_pton(AF_INET, address.c_str(), &arm.sin_addr);
    tcp_ = ::socket(AF_INET, SOCK_STREAM, 0);
    if (::connect(tcp_, reinterpret_cast<sockaddr*>(&arm), sizeof arm) != 0) throw std::runtime_error("no connection");
    const int on = 1;  // what is written is sent, and does not wait for the acknowledgement of what was before
    ::setsockopt(tcp_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    sockaddr_in own{};
    socklen_t size = sizeof own;
    ::getsockname(tcp_, reinterpret_cast<sockaddr*>(&own), &size);
    own.sin_port = 0;
    udp_ = ::socket(AF_INET, SOCK_DGRAM, 0);
    ::bind(udp_, reinterpret_cast<sockaddr*>(&own), sizeof own);
    ::getsockname(udp_, reinterpret_cast<sockaddr*>(&own), &size);
    udp_port_ = ntohs(own.sin_port);
  }
  ~RawSockets() {
    ::close(tcp_);
    ::close(udp_);
  }
  RawSockets(const RawSockets&) = delete;

  std::uint16_t udp_port() const { return udp_port_; }
  void write(std::span<const std::byte> bytes) { ::send(tcp_, bytes.data(), bytes.size(), MSG_NOSIGNAL); }
  void write(const std::string& text) { write(std::as_bytes(std::span(text))); }

  Bytes read(std::size_t size) {
    Bytes bytes(size);
    std::size_t got = 0;
    while (got < size) {
      wait(tcp_);
      const ssize_t count = ::recv(tcp_, bytes.data() + got, size - got, 0);
      if (count <= 0) throw std::runtime_error("the arm closed the connection");
      got += static_cast<std::size_t>(count);
    }
    return bytes;
  }
  bool readable() const {
    pollfd wanted{tcp_, POLLIN, 0};
    return ::poll(&wanted, 1, 0) > 0;
  }
  // Waits until the arm has closed the connection; what it sent before is dropped.
  bool closed() {
    std::byte bytes[4096];
    for (;;) {
      wait(tcp_);
      if (::recv(tcp_, bytes, sizeof bytes, 0) <= 0) return true;
    }
  }

  Bytes datagram() {
    wait(udp_);
    Bytes bytes(4096);
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t got = ::recvfrom(udp_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
    bytes.resize(static_cast<std::size_t>(got));
    from_ = from;
    return bytes;
  }
  bool datagram_there() const {
    pollfd wanted{udp_, POLLIN, 0};
    return ::poll(&wanted, 1, 0) > 0;
  }
  void send_datagram(std::span<const std::byte> bytes) {
    ::sendto(udp_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&from_), sizeof from_);
    if (driven_) driven_->wait_for_datagram();
  }

 private:
  static bool there(int fd, int milliseconds) {
    pollfd wanted{fd, POLLIN, 0};
    return ::poll(&wanted, 1, milliseconds) > 0;
  }
  void wait(int fd) const {
    for (int i = 0; driven_ && i < 20'000 && !there(fd, 0); ++i) {
      driven_->cycle();
      if (states_ && fd == udp_) there(fd, 10'000);  // there is one after each cycle
    }
    if (!there(fd, 10'000)) throw std::runtime_error("the arm is silent");
  }

  DrivenArm* driven_ = nullptr;
  bool states_ = false;  // the port sends one every cycle
  int tcp_ = -1, udp_ = -1;
  std::uint16_t udp_port_ = 0;
  sockaddr_in from_{};
};

// Speaks to the robot's port as a client of a version would.
class RawClient {
 public:
  struct Response {
    fci::Header header;
    std::uint8_t status = 255;
    Bytes body;  // behind the status
  };

  // `arm`: a DrivenArm, or the address of one that runs by itself.
  template <class Arm>
  RawClient(Arm& arm, fci::Version version) : sockets(arm, fci::kRobotPort), version_(version) {
    connected = post(fci::Connect{version, sockets.udp_port()});
    connect_answer = response();
    if (connect_answer.status == 0) receive();
  }

  // Sends a request; its id.
  template <class Request>
  std::uint32_t post(const Request& request) {
    std::array<std::byte, fci::kMaxRequestSize> bytes;
    const std::size_t size = fci::write_request(version_, next_id_, request, std::span(bytes));
    if (size == 0) throw std::runtime_error("this version has no such request");
    sockets.write(std::span(bytes).first(size));
    return next_id_++;
  }

  Response response() {
    Response response;
    const Bytes head = sockets.read(fci::kHeaderSize);
    fci::read(version_, head, response.header);
    const Bytes body = sockets.read(response.header.size - fci::kHeaderSize);
    response.status = std::to_integer<std::uint8_t>(body.at(0));
    response.body.assign(body.begin() + 1, body.end());
    return response;
  }
  // The meaning of the answer to a request, once it comes.
  fci::Status answer(std::uint32_t id) {
    const Response got = response();
    EXPECT_EQ(got.header.command_id, id);
    return fci::status_of(version_, *fci::command_of(version_, got.header.command), got.status).value();
  }
  template <class Request>
  fci::Status ask(const Request& request) {
    return answer(post(request));
  }

  // The next state.
  const fci::RobotState& receive() {
    const Bytes bytes = sockets.datagram();
    if (bytes.size() != fci::size_of<fci::RobotState>(version_)) {
      throw std::runtime_error("a state of " + std::to_string(bytes.size()) + " bytes");
    }
    fci::read(version_, bytes, state);
    return state;
  }
  // The newest state.
  const fci::RobotState& newest() {
    do {
      receive();
    } while (sockets.datagram_there());
    return state;
  }
  // A state from after now: one may be under way already.
  const fci::RobotState& fresh() {
    newest();
    receive();
    return receive();
  }
  template <class Condition>
  const fci::RobotState& receive_until(Condition&& condition) {
    for (int i = 0; i < 5000; ++i) {
      if (condition(receive())) return state;
    }
    throw std::runtime_error("the state that was waited for has not come");
  }
  bool shows(const fci::Move& move) const {
    return state.motion_generator_mode == move.motion_generator_mode && state.controller_mode == move.controller_mode &&
           state.robot_mode == fci::RobotMode::kMove;
  }
  static bool idle(const fci::RobotState& state) {
    return state.motion_generator_mode == fci::MotionGeneratorMode::kIdle &&
           state.controller_mode != fci::ControllerMode::kExternal && state.robot_mode == fci::RobotMode::kIdle;
  }

  // For the state that came last.
  void send(fci::RobotCommand command) {
    command.message_id = state.message_id;
    std::array<std::byte, fci::kMaxCommandSize> bytes;
    sockets.send_datagram(std::span(bytes).first(fci::write(version_, command, bytes)));
  }

  // Starts a motion; returns with its first state.
  void start(const fci::Move& request) {
    move_id = post(request);
    const fci::Status status = answer(move_id);
    if (status != fci::Status::kMotionStarted) throw std::runtime_error(std::string(name(status)));
    receive_until([&](const fci::RobotState&) { return shows(request); });
    while (sockets.datagram_there()) receive();
  }
  // What holds the arm where the state of the motion's start has it.
  fci::RobotCommand hold() const {
    fci::RobotCommand command;
    command.q_c = state.q_d;
    command.O_T_EE_c = state.O_T_EE_c;
    return command;
  }
  // One cycle after the other: the command that make(i) gives, i = 0 to cycles - 1, for each state; returns with the
  // state that answers the last.
  template <class Make>
  void drive(int cycles, Make&& make) {
    for (int i = 0; i < cycles; ++i) {
      send(make(i));
      receive();
    }
  }
  // Finishes the motion with that command; the answer to its Move.
  fci::Status finish(fci::RobotCommand command) {
    command.motion_generation_finished = command.torque_command_finished = true;
    for (;;) {
      send(command);
      receive();
      if (state.motion_generator_mode == fci::MotionGeneratorMode::kIdle) break;
    }
    return answer(move_id);
  }

  RawSockets sockets;
  std::uint32_t connected = 0;
  Response connect_answer;
  std::uint32_t move_id = 0;
  fci::RobotState state;

 private:
  fci::Version version_;
  std::uint32_t next_id_ = 0;
};

// Speaks to the hand's port.
class RawGripper {
 public:
  template <class Arm>
  explicit RawGripper(Arm& arm, fci::Version version = fci::gripper::kVersion) : sockets(arm, fci::gripper::kPort) {
    const auto id = post(fci::gripper::Connect{version, sockets.udp_port()});
    connect_status = answer(id, 4);
  }

  template <class Request>
  std::uint32_t post(const Request& request) {
    Bytes bytes(fci::gripper::kHeaderSize + fci::size_of<Request>(0));
    fci::write(0, fci::gripper::Header{Request::kCommand, next_id_, static_cast<std::uint32_t>(bytes.size())}, bytes);
    fci::write(0, request, std::span(bytes).subspan(fci::gripper::kHeaderSize));
    sockets.write(bytes);
    return next_id_++;
  }
  fci::gripper::Status answer(std::uint32_t id, std::size_t size = 2) {
    const Bytes bytes = sockets.read(fci::gripper::kHeaderSize + size);
    fci::gripper::Header header;
    fci::read(0, bytes, header);
    EXPECT_EQ(header.command_id, id);
    EXPECT_EQ(header.size, bytes.size());
    std::uint16_t status;
    std::memcpy(&status, bytes.data() + fci::gripper::kHeaderSize, sizeof status);
    return static_cast<fci::gripper::Status>(status);
  }
  template <class Request>
  fci::gripper::Status ask(const Request& request) {
    return answer(post(request));
  }
  const fci::gripper::State& newest() {
    do {
      const Bytes bytes = sockets.datagram();
      EXPECT_EQ(bytes.size(), fci::gripper::kStateSize);
      fci::read(0, bytes, state);
    } while (sockets.datagram_there());
    return state;
  }

  // A state from after now: one may be under way already.
  const fci::gripper::State& fresh() {
    newest();
    newest();
    return newest();
  }

  RawSockets sockets;
  fci::gripper::Status connect_status;
  fci::gripper::State state;

 private:
  std::uint32_t next_id_ = 0;
};

}  // namespace testing_tools
