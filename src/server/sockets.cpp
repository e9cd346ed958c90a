#include "server/sockets.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <cstring>

#include "server/realtime_setup.hpp"

namespace server {
namespace {

constexpr std::size_t kMostConnections = 512;
constexpr std::size_t kOtherFiles = 128;  // robot, hand, recordings, and what libraries open
constexpr std::size_t kSockets = 4;       // more than a program of ours binds

}  // namespace

void notice_the_gone(zmq::socket_t& socket) {
  socket.set(zmq::sockopt::tcp_keepalive, 1);
  socket.set(zmq::sockopt::tcp_keepalive_idle, 10);   // s of silence, after which it asks
  socket.set(zmq::sockopt::tcp_keepalive_intvl, 5);   // s, and again
  socket.set(zmq::sockopt::tcp_keepalive_cnt, 3);     // times, and takes the client for gone
}

std::string bind(zmq::socket_t& socket, const Listen& listen, std::uint16_t port) {
  notice_the_gone(socket);
  if (listen.keys != nullptr) guard(socket, *listen.keys);
  try {
    socket.bind("tcp://" + listen.address + ":" + (port == 0 ? "*" : std::to_string(port)));
  } catch (const zmq::error_t& error) {
    if (port == 0 || error.num() != EADDRINUSE) throw;
    socket.bind("tcp://" + listen.address + ":*");
  }
  return socket.get(zmq::sockopt::last_endpoint);
}

std::uint16_t port_of(const std::string& endpoint) {
  const auto colon = endpoint.rfind(':');
  return colon == std::string::npos ? 0 : static_cast<std::uint16_t>(std::atoi(endpoint.c_str() + colon + 1));
}

void hang_up(int fd, const std::string& endpoint) {
  sockaddr_in own{};
  socklen_t size = sizeof own;
  if (getsockname(fd, reinterpret_cast<sockaddr*>(&own), &size) != 0 || own.sin_family != AF_INET) return;
  if (ntohs(own.sin_port) == port_of(endpoint)) shutdown(fd, SHUT_RDWR);
}

std::size_t most_connections() {
  rlimit files{};
  getrlimit(RLIMIT_NOFILE, &files);
  const std::size_t free = files.rlim_cur > kOtherFiles ? files.rlim_cur - kOtherFiles : 0;
  return std::clamp<std::size_t>(free / kSockets, 8, kMostConnections);
}

ConnectionLimit::ConnectionLimit(zmq::context_t& context, zmq::socket_t& socket, std::size_t most)
    : socket_(socket),
      endpoint_(socket.get(zmq::sockopt::last_endpoint)),
      most_(most),
      events_(context, zmq::socket_type::pair) {
  const std::string address = "inproc://connections of " + endpoint_;
  if (zmq_socket_monitor(socket.handle(), address.c_str(), ZMQ_EVENT_ACCEPTED | ZMQ_EVENT_DISCONNECTED) != 0) {
    throw zmq::error_t();
  }
  events_.set(zmq::sockopt::linger, 0);
  events_.set(zmq::sockopt::rcvhwm, 0);  // or the library's own thread would wait for us
  events_.connect(address);
}

ConnectionLimit::~ConnectionLimit() { zmq_socket_monitor(socket_.handle(), nullptr, 0); }

void ConnectionLimit::look(const std::function<void(int fd)>& came) {
  const std::uint64_t before = ended_;
  zmq::message_t event, address;
  while (events_.recv(event, zmq::recv_flags::dontwait)) {
    if (event.more() && !events_.recv(address)) return;
    std::uint16_t what;
    std::uint32_t fd;
    if (event.size() != sizeof what + sizeof fd) continue;
    std::memcpy(&what, event.data<char>(), sizeof what);
    std::memcpy(&fd, event.data<char>() + sizeof what, sizeof fd);
    if (what == ZMQ_EVENT_DISCONNECTED) {
      connections_.erase(static_cast<int>(fd));
    } else if (connections_.size() < most_) {
      connections_.insert(static_cast<int>(fd));
      came(static_cast<int>(fd));
    } else {
      hang_up(static_cast<int>(fd), endpoint_);
      ++ended_;
    }
  }
  // Each power of two once: whoever goes on does not fill the log.
  if (std::bit_width(before) != std::bit_width(ended_)) {
    spdlog::warn("{} has {} connections, as many as it may: {} more were ended. Does a program open them and not close them?", endpoint_,
                 most_, ended_);
  }
}

zmq::context_t preferred_context() {
  const Preferred preferred;
  zmq::context_t context;
  zmq::socket_t(context, zmq::socket_type::pair);  // with the first, its thread begins
  return context;
}

}  // namespace server
