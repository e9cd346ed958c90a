#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "models/arm.hpp"
#include "tests/sim/free_address.hpp"
#include "wire/fci/service.hpp"

namespace server {

using testing_tools::free_address;  // the FCI's ports are fixed, so each robot needs one of its own

// As much of a FER (protocol 5) as connecting needs: it accepts one client after another, sends states of
// an arm that holds itself at home, and refuses every request.
class FakeRobot {
 public:
  static constexpr fci::Version kVersion = 5;

  explicit FakeRobot(const std::string& address) {
    address_ = {.sin_family = AF_INET, .sin_port = htons(fci::kRobotPort), .sin_addr = {}, .sin_zero = {}};
    inet_pton(AF_INET, address.c_str(), &address_.sin_addr);
    listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const int on = 1;
    setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (bind(listener_, reinterpret_cast<sockaddr*>(&address_), sizeof address_) != 0 || listen(listener_, 4) != 0) {
      throw std::runtime_error("no listener");
    }
    thread_ = std::thread([this] { run(); });
  }
  ~FakeRobot() {
    quit_ = true;
    thread_.join();
    close(listener_);
  }

  int connections() const { return connections_; }

 private:
  void run() {
    while (!quit_) {
      pollfd ready{listener_, POLLIN, 0};
      if (poll(&ready, 1, 20) <= 0) continue;
      sockaddr_in client{};
      socklen_t size = sizeof client;
      const int tcp = accept4(listener_, reinterpret_cast<sockaddr*>(&client), &size, SOCK_CLOEXEC);
      if (tcp < 0) continue;
      serve(tcp, client);
      close(tcp);
    }
  }

  void serve(int tcp, sockaddr_in client) {
    std::array<std::byte, 4096> bytes;
    fci::Connect connect;
    if (recv(tcp, bytes.data(), fci::kHeaderSize + 4, MSG_WAITALL) != fci::kHeaderSize + 4) return;
    fci::read(kVersion, std::span(bytes).subspan(fci::kHeaderSize), connect);
    const bool compatible = connect.version == kVersion;
    fci::Header header{0, 0, static_cast<std::uint32_t>(fci::kHeaderSize + 3)};
    fci::write(kVersion, header, bytes);
    fci::write(kVersion, fci::ConnectResponse{static_cast<std::uint8_t>(compatible ? 0 : 1), kVersion},
               std::span(bytes).subspan(fci::kHeaderSize));
    send(tcp, bytes.data(), header.size, MSG_NOSIGNAL);
    if (!compatible) return;

    ++connections_;
    client.sin_port = htons(connect.udp_port);
    const int udp = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in from = address_;
    from.sin_port = 0;
    bind(udp, reinterpret_cast<sockaddr*>(&from), sizeof from);
    fci::RobotState state;
    state.q = state.q_d = models::kHome;
    while (!quit_) {
      state.message_id = ++message_id_;
      const auto size = fci::write(kVersion, state, bytes);
      sendto(udp, bytes.data(), size, 0, reinterpret_cast<sockaddr*>(&client), sizeof client);
      const ssize_t got = recv(tcp, bytes.data(), bytes.size(), MSG_DONTWAIT);
      if (got == 0) break;
      if (got >= static_cast<ssize_t>(fci::kHeaderSize)) refuse(tcp, bytes);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    close(udp);
  }

  void refuse(int tcp, const std::array<std::byte, 4096>& request) {
    fci::Header header;
    fci::read(kVersion, request, header);
    const auto command = fci::command_of(kVersion, header.command);
    if (!command) return;
    header.size = fci::kHeaderSize + 1;
    std::array<std::byte, fci::kHeaderSize + 1> bytes;
    fci::write(kVersion, header, bytes);
    bytes[fci::kHeaderSize] =
        static_cast<std::byte>(fci::status_byte(kVersion, *command, fci::Status::kNotPossible).value_or(1));
    send(tcp, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }

  sockaddr_in address_;
  int listener_;
  std::atomic<int> connections_{0};
  std::uint64_t message_id_ = 0;
  std::atomic<bool> quit_{false};
  std::thread thread_;
};

}  // namespace server
