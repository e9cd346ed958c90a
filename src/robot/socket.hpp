#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <netinet/in.h>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

namespace robot {

// Why there is no connection: what was tried, what came back, what to do.
struct ConnectError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// A file descriptor with an owner.
class Socket {
 public:
  explicit Socket(int fd = -1) : fd_(fd) {}
  Socket(Socket&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Socket& operator=(Socket&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Socket();

  int fd() const { return fd_; }

 private:
  int fd_;
};

using Clock = std::chrono::steady_clock;

// What the client of a robot needs of TCP and UDP while it connects: blocking, with a deadline, and throwing
// ConnectError. `who` names the peer in messages, `remedy` ends them.
struct Peer {
  std::string who;     // "the robot at 172.16.0.2"
  std::string remedy;  // what to check when it does not answer
  sockaddr_in address{};

  // Resolves a name or number; the port is the one to talk to.
  Peer(const std::string& kind, const std::string& host, std::uint16_t port, const std::string& remedy);

  Socket connect(Clock::time_point deadline) const;
  // Bound to the address that the peer of `tcp` reaches us by, on a free port.
  Socket udp(const Socket& tcp, std::uint16_t& port) const;
  void send(const Socket& tcp, std::span<const std::byte> message, Clock::time_point deadline) const;
  // Fills `out`; `what` is awaited, for the message.
  void receive(const Socket& tcp, std::span<std::byte> out, const std::string& what,
               Clock::time_point deadline) const;

  // Whether a datagram from there may be the peer's: from its address or, where it is simulated on this computer and
  // bound to no address, from another loopback one.
  bool owns(const sockaddr_in& from) const;

  std::string endpoint() const;  // "172.16.0.2, TCP port 1337"
};

// True when `fd` can be read (or has failed) before the deadline.
bool wait_readable(int fd, Clock::time_point deadline);

}  // namespace robot
