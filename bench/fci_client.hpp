#pragma once

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "wire/fci/robot_command.hpp"
#include "wire/fci/robot_state.hpp"
#include "wire/fci/service.hpp"

namespace bench {

// A client of an arm with nothing in it that takes time. Blocks; throws std::runtime_error when the arm says no.
class FciClient {
 public:
  static constexpr fci::Version kVersion = fci::kNewestVersion;

  explicit FciClient(const std::string& address)
      : tcp_(::socket(AF_INET, SOCK_STREAM, 0)), udp_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    sockaddr_in arm{}, own{};
    arm.sin_family = own.sin_family = AF_INET;
    arm.sin_port = htons(fci::kRobotPort);
    ::inet_pton(AF_INET, address.c_str(), &arm.sin_addr);
    for (int attempt = 0; ::connect(tcp_, reinterpret_cast<sockaddr*>(&arm), sizeof arm) != 0; ++attempt) {
      if (attempt > 100) throw std::runtime_error("no arm answers on " + address);
      ::usleep(50'000);
    }
    socklen_t size = sizeof own;
    ::getsockname(tcp_, reinterpret_cast<sockaddr*>(&own), &size);
    own.sin_port = 0;
    ::bind(udp_, reinterpret_cast<sockaddr*>(&own), sizeof own);
    ::getsockname(udp_, reinterpret_cast<sockaddr*>(&own), &size);
    const timeval patience{1, 0};
    ::setsockopt(udp_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    ask(fci::Connect{kVersion, ntohs(own.sin_port)});
    ::connect(udp_, reinterpret_cast<sockaddr*>(&arm), sizeof arm);
  }
  ~FciClient() {
    ::close(tcp_);
    ::close(udp_);
  }
  FciClient(const FciClient&) = delete;

  int udp() const { return udp_; }

  // The status byte of the answer is to be 0, or 1 (kMotionStarted) to a Move.
  template <class Request>
  void ask(const Request& request) {
    std::array<std::byte, fci::kMaxRequestSize> bytes;
    const std::size_t size = fci::write_request(kVersion, id_++, request, std::span(bytes));
    if (::send(tcp_, bytes.data(), size, 0) != static_cast<ssize_t>(size)) throw std::runtime_error("the arm has gone");
    fci::Header header;
    read(bytes.data(), fci::kHeaderSize);
    fci::read(kVersion, std::span(bytes).first(fci::kHeaderSize), header);
    read(bytes.data(), header.size - fci::kHeaderSize);
    if (std::to_integer<int>(bytes[0]) > 1) throw std::runtime_error("the arm refuses a request");
  }

  // The next state. Polls for it first: it is not the arm's work to wake a client that sleeps.
  const fci::RobotState& receive() {
    std::array<std::byte, fci::kMaxStateSize> bytes;
    constexpr int kPolls = 2000;
    ssize_t got = -1;
    for (int i = 0; i < kPolls && got <= 0; ++i) got = ::recv(udp_, bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (got <= 0) got = ::recv(udp_, bytes.data(), bytes.size(), 0);
    if (got <= 0) throw std::runtime_error("the arm is silent");
    fci::read(kVersion, bytes, state_);
    return state_;
  }
  // For the state that came last.
  void send(fci::RobotCommand command) {
    command.message_id = state_.message_id;
    std::array<std::byte, fci::kMaxCommandSize> bytes;
    ::send(udp_, bytes.data(), fci::write(kVersion, command, bytes), 0);
  }

 private:
  void read(std::byte* to, std::size_t size) {
    while (size > 0) {
      const ssize_t got = ::recv(tcp_, to, size, 0);
      if (got <= 0) throw std::runtime_error("the arm has gone");
      to += got;
      size -= static_cast<std::size_t>(got);
    }
  }

  int tcp_, udp_;
  std::uint32_t id_ = 0;
  fci::RobotState state_;
};

// An address of this computer that hardly anybody else takes.
inline std::string some_address() {
  std::srand(static_cast<unsigned>(::getpid()));
  return "127." + std::to_string(1 + std::rand() % 250) + "." + std::to_string(1 + std::rand() % 250) + "." +
         std::to_string(1 + std::rand() % 250);
}

}  // namespace bench
