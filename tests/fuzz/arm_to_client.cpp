// Anything that a robot or a hand can send to the server's clients of them: an answer or an error, never a crash, and no
// state that is no number.

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "robot/fci_driver.hpp"
#include "robot/gripper_client.hpp"
#include "require.hpp"
#include "script.hpp"
#include "wire/fci/gripper.hpp"
#include "wire/fci/service.hpp"

namespace {

enum Step { kTcp, kUdp, kSteps };
constexpr std::size_t kConnectSize = 16;  // of the robot's; the hand's has two bytes less
constexpr int kMostStates = 200;

using fuzz::require;

// A peer that says to each client what the script says, and hangs up.
class Peer {
 public:
  explicit Peer(std::uint16_t port) {
    std::random_device random;
    while (listening_ < 0) {
      const auto part = [&] { return std::to_string(random() % 250 + 2); };
      address = "127." + part() + "." + part() + "." + part();
      listening_ = bound(SOCK_STREAM, port);
      if (listening_ < 0) continue;
      udp_ = bound(SOCK_DGRAM, port);
    }
    ::listen(listening_, 8);
  }

  // For all clients that come until stop().
  void play(fuzz::Script script, std::size_t connect_size) {
    thread_ = std::thread([this, script, connect_size] {
      for (;;) {
        const int client = ::accept4(listening_, nullptr, nullptr, SOCK_CLOEXEC);
        if (client < 0) return;
        std::array<std::byte, kConnectSize> connect{};
        const ssize_t got = ::recv(client, connect.data(), connect_size, MSG_WAITALL);
        sockaddr_in to{};
        socklen_t size = sizeof to;
        ::getpeername(client, reinterpret_cast<sockaddr*>(&to), &size);
        if (got == static_cast<ssize_t>(connect_size)) {
          std::uint16_t port = 0;
          std::memcpy(&port, connect.data() + connect_size - sizeof port, sizeof port);
          to.sin_port = htons(port);
          fuzz::Script steps = script;
          int what = 0;
          std::span<const std::byte> bytes;
          while (steps.next(what, bytes)) {
            if (what % kSteps == kTcp) {
              ::send(client, bytes.data(), bytes.size(), MSG_NOSIGNAL);
            } else {
              ::sendto(udp_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
            }
          }
        }
        const linger now{1, 0};
        ::setsockopt(client, SOL_SOCKET, SO_LINGER, &now, sizeof now);
        ::shutdown(client, SHUT_WR);
        std::byte rest[256];
        while (::recv(client, rest, sizeof rest, 0) > 0) {
        }
        ::close(client);
        if (stopped_) return;
      }
    });
  }

  void stop() {
    stopped_ = true;
    // One more client, which wakes accept().
    sockaddr_in name{};
    socklen_t size = sizeof name;
    ::getsockname(listening_, reinterpret_cast<sockaddr*>(&name), &size);
    const int last = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    ::connect(last, reinterpret_cast<sockaddr*>(&name), size);
    ::close(last);
    thread_.join();
    stopped_ = false;
    // What came too late to be taken.
    for (pollfd late{listening_, POLLIN, 0}; ::poll(&late, 1, 0) > 0;) ::close(::accept(listening_, nullptr, nullptr));
  }

  std::string address;

 private:
  int bound(int type, std::uint16_t port) {
    const int fd = ::socket(AF_INET, type | SOCK_CLOEXEC, 0);
    const int on = 1;
    ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    sockaddr_in name{};
    name.sin_family = AF_INET;
    name.sin_port = htons(port);
    ::inet_pton(AF_INET, address.c_str(), &name.sin_addr);
    if (::bind(fd, reinterpret_cast<sockaddr*>(&name), sizeof name) == 0) return fd;
    ::close(fd);
    return -1;
  }

  int listening_ = -1, udp_ = -1;
  std::atomic<bool> stopped_{false};
  std::thread thread_;
};

void try_robot(Peer& peer) {
  try {
    const auto driver = robot::FciDriver::connect(peer.address);
    fci::RobotState state;
    for (int i = 0; i < kMostStates && driver->receive(state) == robot::Received::kState; ++i) {
      for (double q : state.q) require(std::isfinite(q), "a state that is no number");
      fci::RobotCommand command;
      command.message_id = state.message_id;
      driver->send(command);
      driver->post(fci::StopMove{});
      while (driver->poll()) {
      }
    }
  } catch (const robot::ConnectError&) {
  }
}

void try_hand(Peer& peer) {
  try {
    robot::GripperClient hand(peer.address);
    hand.move(0.04, 0.1);
    if (const auto state = hand.state()) require(std::isfinite(state->width), "a width that is no number");
  } catch (const robot::ConnectError&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Peer robot(fci::kRobotPort), hand(fci::gripper::kPort);
  if (size == 0) return 0;
  const bool to_robot = data[0] % 2 == 0;
  Peer& peer = to_robot ? robot : hand;
  peer.play({data + 1, size - 1}, to_robot ? kConnectSize : kConnectSize - 2);
  if (to_robot) {
    try_robot(peer);
  } else {
    try_hand(peer);
  }
  peer.stop();
  return 0;
}
