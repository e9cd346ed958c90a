#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <utility>
#include <zmq.hpp>

#include "server/keys.hpp"

namespace server {

// Where a server listens, and whom it lets in.
struct Listen {
  Listen(const char* address) : address(address) {}
  Listen(std::string address, const Keys* keys = nullptr) : address(std::move(address)), keys(keys) {}

  std::string address;
  const Keys* keys = nullptr;  // null: everybody who reaches it; else there is a Doorkeeper in the context
};

// Has a socket, before it is bound, notice clients whose computer or network is gone without a word.
void notice_the_gone(zmq::socket_t& socket);

// Binds to tcp://listen:port, or to a free port where `port` is 0 or taken; returns the endpoint.
std::string bind(zmq::socket_t& socket, const Listen& listen, std::uint16_t port);

// Port of "tcp://address:port"; 0 when there is none.
std::uint16_t port_of(const std::string& endpoint);

// Ends the connection `fd` of a socket that is bound to `endpoint`; nothing where that number stands for something else by now.
void hang_up(int fd, const std::string& endpoint);

// How many connections a socket of this program may have: 512, or what its limit of open files leaves.
std::size_t most_connections();

// Keeps the connections of a bound socket below a number, so that clients do not use up the program's open files: ends those
// that come beyond it. For the thread of the socket.
class ConnectionLimit {
 public:
  ConnectionLimit(zmq::context_t& context, zmq::socket_t& socket, std::size_t most = most_connections());
  ~ConnectionLimit();

  // Looks at what came and went, and tells of each that came; many times a second.
  void look(const std::function<void(int fd)>& came = [](int) {});

 private:
  zmq::socket_t& socket_;
  const std::string endpoint_;
  const std::size_t most_;
  zmq::socket_t events_;
  std::set<int> connections_;  // file descriptors
  std::uint64_t ended_ = 0;
};

// A context whose own thread goes before ordinary ones, where that is permitted (Preferred).
zmq::context_t preferred_context();

}  // namespace server
