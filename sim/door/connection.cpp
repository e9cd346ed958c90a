#include "sim/door/connection.hpp"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace sim {
namespace {

// More than this lies unread only with a client that is no client.
constexpr std::size_t kMaxBacklog = 1 << 20;  // bytes

sockaddr_in endpoint(const in_addr& address, std::uint16_t port) {
  sockaddr_in endpoint{};
  endpoint.sin_family = AF_INET;
  endpoint.sin_addr = address;
  endpoint.sin_port = htons(port);
  return endpoint;
}

void bind(const File& socket, const in_addr& address, std::uint16_t port, const char* protocol) {
  const sockaddr_in own = endpoint(address, port);
  if (::bind(socket.fd(), reinterpret_cast<const sockaddr*>(&own), sizeof own) == 0) return;
  const std::string where = std::string(protocol) + " port " + std::to_string(port) + " of " + text(address);
  switch (errno) {
    case EADDRINUSE:
      throw std::runtime_error(where + " is taken: another simulated arm runs there? Stop it, or give this one another "
                               "address with --listen (127.0.0.2, ...)");
    case EADDRNOTAVAIL:
      throw std::runtime_error(text(address) + " is no address of this computer: give --listen one of its own "
                               "(127.0.0.1 to 127.255.255.254 always are)");
    default: throw std::runtime_error("cannot use " + where + ": " + std::strerror(errno));
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

File::~File() {
  if (fd_ >= 0) ::close(fd_);
}

Poller::Poller(Clock& clock) : clock_(clock), epoll_(::epoll_create1(EPOLL_CLOEXEC)) {}

void Poller::add(int fd) {
  epoll_event event{};
  event.events = EPOLLIN;
  event.data.fd = fd;
  ::epoll_ctl(epoll_.fd(), EPOLL_CTL_ADD, fd, &event);
}

bool Poller::ready() const {
  epoll_event event;
  return ::epoll_wait(epoll_.fd(), &event, 1, 0) > 0;
}

bool Connection::receive() {
  std::byte buffer[4096];
  for (;;) {
    const ssize_t got = ::recv(socket_.fd(), buffer, sizeof buffer, MSG_DONTWAIT);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return errno == EAGAIN;
    if (got == 0) return false;
    if (in_.empty()) since_ = clock_->now();
    in_.insert(in_.end(), buffer, buffer + got);
    // The rest comes with the next call: a client that never stops sending must not hold up the cycle.
    if (in_.size() >= sizeof buffer) return true;
  }
}

void Connection::consume(std::size_t bytes) {
  in_.erase(in_.begin(), in_.begin() + static_cast<std::ptrdiff_t>(bytes));
  since_ = clock_->now();
}

void Connection::send(std::span<const std::byte> bytes) {
  out_.insert(out_.end(), bytes.begin(), bytes.end());
  flush();
}

bool Connection::flush() {
  while (!out_.empty()) {
    const ssize_t sent = ::send(socket_.fd(), out_.data(), out_.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent < 0) return errno == EAGAIN && out_.size() < kMaxBacklog;
    out_.erase(out_.begin(), out_.begin() + sent);
  }
  return true;
}

std::string Connection::name() const { return text(peer_.sin_addr) + ":" + std::to_string(ntohs(peer_.sin_port)); }

Listener::Listener(const in_addr& address, std::uint16_t port, Poller& poller)
    : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)), poller_(poller) {
  const int on = 1;  // a port whose connections were just closed is free
  ::setsockopt(socket_.fd(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  bind(socket_, address, port, "TCP");
  if (::listen(socket_.fd(), 16) != 0) {
    throw std::runtime_error("cannot listen on TCP port " + std::to_string(port) + " of " + text(address) + ": " +
                             std::strerror(errno));
  }
  poller_.add(socket_.fd());
}

std::optional<Connection> Listener::accept() {
  sockaddr_in peer{};
  socklen_t size = sizeof peer;
  File socket(::accept4(socket_.fd(), reinterpret_cast<sockaddr*>(&peer), &size, SOCK_NONBLOCK | SOCK_CLOEXEC));
  if (socket.fd() < 0) return std::nullopt;
  const int on = 1;
  ::setsockopt(socket.fd(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  keep_alive(socket.fd());
  poller_.add(socket.fd());
  return Connection(std::move(socket), peer, poller_.clock());
}

File udp_socket(const in_addr& address, std::uint16_t port) {
  File socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  bind(socket, address, port, "UDP");
  return socket;
}

in_addr parse_address(const std::string& text) {
  in_addr address{};
  if (::inet_pton(AF_INET, text.c_str(), &address) != 1) {
    throw std::runtime_error("\"" + text + "\" is no IPv4 address: give --listen one such as 127.0.0.1");
  }
  return address;
}

std::string text(const in_addr& address) {
  char buffer[INET_ADDRSTRLEN] = "";
  ::inet_ntop(AF_INET, &address, buffer, sizeof buffer);
  return buffer;
}

}  // namespace sim
