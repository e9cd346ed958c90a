#pragma once

#include <list>
#include <optional>
#include <string_view>

#include "sim/door/connection.hpp"

namespace sim {

// A TCP port of the robot that serves one client at a time: takes it in with Connect, cuts what it sends into messages,
// drops it when that is garbage or stops in the middle. Whoever comes while there is a client is closed at once: it
// waits for the answer to its Connect, and so has an error instead of silence. Nothing here waits for anybody.
class Port {
 public:
  virtual ~Port() = default;

  // New clients, requests, clients that have gone.
  void serve();
  // There is something to serve that no socket tells of.
  bool due() const { return !waiting_.empty() || (client_ && (client_->waiting() || !client_->received().empty())); }

 protected:
  struct Header {
    std::uint32_t command = 0, id = 0, size = 0;
  };

  // `sizes`: bytes of a header, and of the longest message with it. Throws std::runtime_error when the port cannot
  // be had.
  Port(const char* title, const in_addr& address, std::uint16_t port, std::size_t header_size, std::size_t max_size,
       Poller& poller);

  virtual Header read_header(std::span<const std::byte> bytes) const = 0;
  // Answers a Connect. Whether the newcomer is the client now.
  virtual bool connect(Connection& newcomer, std::uint32_t id, std::uint16_t version, std::uint16_t udp_port) = 0;
  // Empty: the client's version has no such request.
  virtual std::string_view request_name(std::uint32_t command) const = 0;
  // Answers a request, now or later. False when it has not the size it should have.
  virtual bool handle(const Header& header, std::span<const std::byte> body) = 0;
  virtual void gone() = 0;

  // Lets a UDP socket speak with that client alone; false where it cannot reach it.
  static bool connect_udp(int fd, sockaddr_in client, std::uint16_t port);

  bool connected() const { return client_.has_value(); }
  Connection& client() { return *client_; }

 private:
  bool greet(Connection& newcomer);
  bool take_request();
  void drop(const std::string& why);
  void refuse(const Connection& newcomer, const std::string& why) const;

  const char* title_;
  std::size_t header_size_, max_size_;
  Listener listener_;
  std::list<Connection> waiting_;  // have not said Connect yet
  std::optional<Connection> client_;
};

}  // namespace sim
