#include "robot/socket.hpp"

#include <arpa/inet.h>
#include <cerrno>
#include <cstring>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

namespace robot {
namespace {

int milliseconds_until(Clock::time_point deadline) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()).count();
  return left > 0 ? static_cast<int>(left) : 0;
}

bool wait_for(int fd, short events, Clock::time_point deadline) {
  pollfd wanted{fd, events, 0};
  for (;;) {
    const int ready = ::poll(&wanted, 1, milliseconds_until(deadline));
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

// One that has lost its power or its cable says no goodbye: it is gone when nothing comes for 4 s. As libfranka has it; but while
// something that was sent is not acknowledged, the system asks for no signs of life, and a time-out of that is needed as well.
void keep_alive(int fd) {
  const auto set = [fd](int level, int option, int value) { ::setsockopt(fd, level, option, &value, sizeof value); };
  set(SOL_SOCKET, SO_KEEPALIVE, 1);
  set(IPPROTO_TCP, TCP_KEEPIDLE, 1);   // s
  set(IPPROTO_TCP, TCP_KEEPINTVL, 1);  // s
  set(IPPROTO_TCP, TCP_KEEPCNT, 3);
  set(IPPROTO_TCP, TCP_USER_TIMEOUT, 4000);  // ms
}

}  // namespace

Socket::~Socket() {
  if (fd_ >= 0) ::close(fd_);
}

bool wait_readable(int fd, Clock::time_point deadline) { return wait_for(fd, POLLIN, deadline); }

Peer::Peer(const std::string& kind, const std::string& host, std::uint16_t port, const std::string& remedy)
    : who(kind + " at " + host), remedy(remedy) {
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int error = ::getaddrinfo(host.c_str(), nullptr, &hints, &found); error != 0) {
    throw ConnectError("The address \"" + host + "\" of " + kind + " cannot be resolved (" + ::gai_strerror(error) +
                       "). Give its IPv4 address, or a host name that this computer knows.");
  }
  std::memcpy(&address, found->ai_addr, sizeof(address));
  address.sin_port = htons(port);
  ::freeaddrinfo(found);
}

bool Peer::owns(const sockaddr_in& from) const {
  const auto on_loopback = [](const sockaddr_in& place) { return ntohl(place.sin_addr.s_addr) >> 24 == IN_LOOPBACKNET; };
  return from.sin_addr.s_addr == address.sin_addr.s_addr || (on_loopback(from) && on_loopback(address));
}

std::string Peer::endpoint() const {
  char text[INET_ADDRSTRLEN] = "";
  ::inet_ntop(AF_INET, &address.sin_addr, text, sizeof(text));
  return std::string(text) + ", TCP port " + std::to_string(ntohs(address.sin_port));
}

Socket Peer::connect(Clock::time_point deadline) const {
  Socket tcp(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  int error = 0;
  if (::connect(tcp.fd(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) error = errno;
  if (error == EINPROGRESS) {
    error = ETIMEDOUT;
    if (wait_for(tcp.fd(), POLLOUT, deadline)) {
      socklen_t size = sizeof(error);
      ::getsockopt(tcp.fd(), SOL_SOCKET, SO_ERROR, &error, &size);
    }
  }
  switch (error) {
    case 0: break;
    case ECONNREFUSED:
      throw ConnectError("Could not connect to " + who + ": " + endpoint() + " refused the connection. " + remedy);
    case ENETUNREACH:
    case EHOSTUNREACH:
      throw ConnectError("Could not connect to " + who + ": this computer has no route to " + endpoint() +
                         ". Check the cable and the network settings (address and mask in the robot's network).");
    case ETIMEDOUT:
      throw ConnectError("Could not connect to " + who + ": " + endpoint() + " did not answer in time. " + remedy);
    default:
      throw ConnectError("Could not connect to " + who + ": " + endpoint() + ": " + std::strerror(error) + ". " +
                         remedy);
  }
  const int on = 1;
  ::setsockopt(tcp.fd(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  keep_alive(tcp.fd());
  return tcp;
}

Socket Peer::udp(const Socket& tcp, std::uint16_t& port) const {
  sockaddr_in own{};
  socklen_t size = sizeof(own);
  ::getsockname(tcp.fd(), reinterpret_cast<sockaddr*>(&own), &size);
  own.sin_port = 0;
  Socket udp(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (::bind(udp.fd(), reinterpret_cast<const sockaddr*>(&own), sizeof(own)) != 0) {
    throw ConnectError("Could not bind a UDP socket for the states of " + who + ": " + std::strerror(errno) + ".");
  }
  size = sizeof(own);
  ::getsockname(udp.fd(), reinterpret_cast<sockaddr*>(&own), &size);
  port = ntohs(own.sin_port);
  return udp;
}

void Peer::send(const Socket& tcp, std::span<const std::byte> message, Clock::time_point deadline) const {
  while (!message.empty()) {
    const ssize_t sent = ::send(tcp.fd(), message.data(), message.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent >= 0) {
      message = message.subspan(static_cast<std::size_t>(sent));
    } else if (errno != EAGAIN && errno != EINTR) {
      throw ConnectError("Lost the connection to " + who + ": " + std::strerror(errno) + ".");
    } else if (!wait_for(tcp.fd(), POLLOUT, deadline)) {
      throw ConnectError("Lost the connection to " + who + ": it takes no more bytes on " + endpoint() + ". " +
                         remedy);
    }
  }
}

void Peer::receive(const Socket& tcp, std::span<std::byte> out, const std::string& what,
                   Clock::time_point deadline) const {
  std::size_t received = 0;
  while (received < out.size()) {
    const ssize_t got = ::recv(tcp.fd(), out.data() + received, out.size() - received, MSG_DONTWAIT);
    if (got > 0) {
      received += static_cast<std::size_t>(got);
    } else if (got == 0 || (errno != EAGAIN && errno != EINTR)) {
      throw ConnectError("Lost the connection to " + who + ": it closed " + endpoint() + " instead of sending " + what +
                         " (" + std::to_string(received) + " of " + std::to_string(out.size()) +
                         " bytes came). Another client may have it: only one is served at a time.");
    } else if (!wait_for(tcp.fd(), POLLIN, deadline)) {
      throw ConnectError("Gave up on " + who + ": " + endpoint() + " did not send " + what + " in time (" +
                         std::to_string(received) + " of " + std::to_string(out.size()) +
                         " bytes came). Another client may have it: only one is served at a time. " + remedy);
    }
  }
}

}  // namespace robot
