#pragma once

#include <netinet/in.h>

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/clock.hpp"

namespace sim {

// An open file of the system; closed with its owner.
class File {
 public:
  File() = default;
  explicit File(int fd) : fd_(fd) {}
  File(File&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  File& operator=(File&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~File();
  int fd() const { return fd_; }

 private:
  int fd_ = -1;
};

// Tells in one cheap call whether anything happened on any TCP socket, and has the time that holds for all sockets.
class Poller {
 public:
  explicit Poller(Clock& clock);
  void add(int fd);
  bool ready() const;
  Clock& clock() const { return clock_; }

 private:
  Clock& clock_;
  File epoll_;
};

// One client's TCP connection. Nothing blocks: what cannot be sent yet waits here.
class Connection {
 public:
  Connection(File socket, const sockaddr_in& peer, const Clock& clock)
      : socket_(std::move(socket)), peer_(peer), clock_(&clock), since_(clock.now()) {}

  // Takes in what has come. False when the connection is over.
  bool receive();
  std::span<const std::byte> received() const { return in_; }
  void consume(std::size_t bytes);
  // For how long (ns) the oldest byte has been waiting for the rest of its message; before the first one, since it
  // connected.
  std::int64_t waits() const { return clock_->now() - since_; }

  void send(std::span<const std::byte> bytes);
  // Sends on what had to wait. False when the connection is over, or its other end takes nothing any more.
  bool flush();
  bool waiting() const { return !out_.empty(); }

  const sockaddr_in& peer() const { return peer_; }
  std::string name() const;  // "127.0.0.1:40512"

 private:
  File socket_;
  sockaddr_in peer_;
  std::vector<std::byte> in_, out_;
  const Clock* clock_;
  std::int64_t since_;  // ns
};

// A TCP port that takes clients.
class Listener {
 public:
  // Throws std::runtime_error which says why the address cannot be used.
  Listener(const in_addr& address, std::uint16_t port, Poller& poller);
  std::optional<Connection> accept();

 private:
  File socket_;
  Poller& poller_;
};

// A UDP socket at address and port (0: any that is free); throws std::runtime_error like Listener.
File udp_socket(const in_addr& address, std::uint16_t port);

// Throws std::runtime_error for anything but an IPv4 address.
in_addr parse_address(const std::string& text);
std::string text(const in_addr& address);

}  // namespace sim
