#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "wire/fci/robot_command.hpp"
#include "wire/fci/service.hpp"

namespace testing_tools {

using Bytes = std::vector<std::byte>;

// A robot or hand that does what its test says, byte by byte, over real sockets on a loopback address of
// its own. A call that waits gives up after 20 seconds and fails the test.
class ScriptedServer {
 public:
  explicit ScriptedServer(std::uint16_t port) : port_(port) {
    std::random_device random;
    for (int tries = 0; tries < 100; ++tries) {
      std::uniform_int_distribution<> part(1, 254);
      address_ = "127." + std::to_string(part(random)) + "." + std::to_string(part(random)) + "." +
                 std::to_string(part(random));
      listening_ = bound(SOCK_STREAM, port);
      if (listening_ >= 0) break;
    }
    if (listening_ < 0) {
      throw std::runtime_error("port " + std::to_string(port) +
                               " is taken at all of 100 loopback addresses: end what listens on it at 0.0.0.0");
    }
    ::listen(listening_, 4);
    udp_ = bound(SOCK_DGRAM, 0);
  }
  ~ScriptedServer() {
    hang_up();
    for (int fd : {listening_, udp_, other_udp_}) {
      if (fd >= 0) ::close(fd);
    }
  }
  ScriptedServer(const ScriptedServer&) = delete;

  const std::string& address() const { return address_; }

  void accept() {
    if (!wait(listening_)) return;
    hang_up();
    tcp_ = ::accept(listening_, nullptr, nullptr);
  }
  void stop_listening() {
    ::close(listening_);
    listening_ = -1;
  }
  void hang_up() {
    if (tcp_ >= 0) ::close(tcp_);
    tcp_ = -1;
  }

  Bytes read(std::size_t size) {
    Bytes bytes(size);
    std::size_t have = 0;
    while (have < size && wait(tcp_)) {
      const ssize_t got = ::recv(tcp_, bytes.data() + have, size - have, 0);
      if (got <= 0) {
        ADD_FAILURE() << "the client hung up";
        break;
      }
      have += static_cast<std::size_t>(got);
    }
    return bytes;
  }
  void write(std::span<const std::byte> bytes) {
    EXPECT_EQ(::send(tcp_, bytes.data(), bytes.size(), MSG_NOSIGNAL), static_cast<ssize_t>(bytes.size()));
  }

  // To the client's UDP port, from the server's socket or, like a stranger or a robot that has changed its
  // port, from another.
  void send_datagram(std::span<const std::byte> bytes) { send_from(udp_, bytes); }
  void send_datagram_from(std::string address, std::span<const std::byte> bytes) {
    if (other_udp_ >= 0) ::close(other_udp_);
    const std::string own = std::exchange(address_, address);
    other_udp_ = bound(SOCK_DGRAM, 0);
    address_ = own;
    send_from(other_udp_, bytes);
  }
  Bytes read_datagram(bool from_other = false) {
    Bytes bytes(4096);
    const int fd = from_other ? other_udp_ : udp_;
    if (!wait(fd)) return {};
    const ssize_t size = ::recv(fd, bytes.data(), bytes.size(), 0);
    bytes.resize(size < 0 ? 0 : static_cast<std::size_t>(size));
    return bytes;
  }

  std::uint16_t client_port = 0;  // for states; from Connect

 private:
  int bound(int type, std::uint16_t port) {
    const int fd = ::socket(AF_INET, type | SOCK_CLOEXEC, 0);
    const int on = 1;
    ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    sockaddr_in address = name(address_, port);
    if (::bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0) return fd;
    ::close(fd);
    return -1;
  }
  static sockaddr_in name(const std::string& address, std::uint16_t port) {
    sockaddr_in out{};
    out.sin_family = AF_INET;
    out.sin_port = htons(port);
    ::inet_pton(AF_INET, address.c_str(), &out.sin_addr);
    return out;
  }
  void send_from(int fd, std::span<const std::byte> bytes) {
    sockaddr_in peer{};
    socklen_t size = sizeof(peer);
    ::getpeername(tcp_, reinterpret_cast<sockaddr*>(&peer), &size);
    peer.sin_port = htons(client_port);
    EXPECT_EQ(::sendto(fd, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&peer), sizeof(peer)),
              static_cast<ssize_t>(bytes.size()));
  }
  static bool wait(int fd) {
    pollfd wanted{fd, POLLIN, 0};
    if (fd >= 0 && ::poll(&wanted, 1, 20000) > 0) return true;
    ADD_FAILURE() << "nothing came within 20 seconds";
    return false;
  }

  std::uint16_t port_;
  std::string address_;
  int listening_ = -1, tcp_ = -1, udp_ = -1, other_udp_ = -1;
};

// The robot's side of the protocol on top.
class ScriptedRobot : public ScriptedServer {
 public:
  explicit ScriptedRobot(fci::Version version) : ScriptedServer(fci::kRobotPort), version(version) {
    state.message_id = 1;
  }

  fci::Version version;
  fci::RobotState state;

  struct Request {
    fci::Header header;
    fci::Command command;
    Bytes body;
  };

  Request request() {
    Request request;
    const Bytes head = read(fci::kHeaderSize);
    fci::read(version, head, request.header);
    const auto command = fci::command_of(version, request.header.command);
    EXPECT_TRUE(command && request.header.size >= fci::kHeaderSize);
    request.command = command.value_or(fci::Command::kConnect);
    if (request.header.size > fci::kHeaderSize) request.body = read(request.header.size - fci::kHeaderSize);
    return request;
  }

  Bytes response(std::uint32_t id, fci::Command command, std::span<const std::byte> body) const {
    Bytes bytes(fci::kHeaderSize + body.size());
    const fci::Header header{*fci::command_id(version, command), id, static_cast<std::uint32_t>(bytes.size())};
    fci::write(version, header, bytes);
    std::copy(body.begin(), body.end(), bytes.begin() + fci::kHeaderSize);
    return bytes;
  }
  Bytes response(std::uint32_t id, fci::Command command, fci::Status status, std::size_t padding = 0) const {
    Bytes body(1 + padding);
    body[0] = std::byte{*fci::status_byte(version, command, status)};
    return response(id, command, body);
  }
  void answer(std::uint32_t id, fci::Command command, fci::Status status) { write(response(id, command, status)); }

  // Accepts a client, takes its Connect and answers; returns the client's version.
  fci::Version take_connect(std::uint8_t status, std::uint16_t answered) {
    accept();
    const Request connect = request();
    EXPECT_EQ(connect.command, fci::Command::kConnect);
    fci::Connect body;
    EXPECT_TRUE(fci::read(version, connect.body, body));
    client_port = body.udp_port;
    Bytes bytes(fci::size_of<fci::ConnectResponse>(version));
    fci::write(version, fci::ConnectResponse{status, answered}, bytes);
    write(response(connect.header.command_id, fci::Command::kConnect, bytes));
    return body.version;
  }

  // As a system of this version does from the first connection to the client's last request.
  void serve_connect() {
    if (take_connect(0, version) != version) ADD_FAILURE() << "Connect with another version";
    serve_rest();
  }
  void serve_rest() {
    send_state();
    if (fci::command_id(version, fci::Command::kGetRobotModel)) serve_model("<robot/>");
  }
  void serve_model(const std::string& urdf) {
    const Request asked = request();
    EXPECT_EQ(asked.command, fci::Command::kGetRobotModel);
    Bytes body(1 + urdf.size());
    std::memcpy(body.data() + 1, urdf.data(), urdf.size());
    write(response(asked.header.command_id, asked.command, body));
  }

  Bytes datagram() const {
    Bytes bytes(fci::size_of<fci::RobotState>(version));
    fci::write(version, state, bytes);
    return bytes;
  }
  void send_state() {
    send_datagram(datagram());
    ++state.message_id;
  }
  fci::RobotCommand command(bool from_other = false) {
    fci::RobotCommand command;
    const Bytes bytes = read_datagram(from_other);
    EXPECT_EQ(bytes.size(), fci::size_of<fci::RobotCommand>(version));
    fci::read(version, bytes, command);
    return command;
  }
};

}  // namespace testing_tools
