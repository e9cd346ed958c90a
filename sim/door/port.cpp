#include "sim/door/port.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "wire/fci/service.hpp"

namespace sim {
namespace {

constexpr std::int64_t kPatience = 1'000'000'000;  // ns, for the rest of a message
constexpr std::size_t kMaxWaiting = 8;             // connections that have not said Connect

}  // namespace

bool Port::connect_udp(int fd, sockaddr_in client, std::uint16_t port) {
  // A socket that was bound to all addresses would keep the one from which its first client was reached.
  sockaddr nobody{};
  nobody.sa_family = AF_UNSPEC;
  ::connect(fd, &nobody, sizeof nobody);
  client.sin_port = htons(port);
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&client), sizeof client) == 0) return true;
  spdlog::warn("a client's port {} for states cannot be reached: {}", port, std::strerror(errno));
  return false;
}

Port::Port(const char* title, const in_addr& address, std::uint16_t port, std::size_t header_size,
           std::size_t max_size, Poller& poller)
    : title_(title), header_size_(header_size), max_size_(max_size), listener_(address, port, poller) {}

void Port::serve() {
  // Newcomers are fetched before the client is looked at: one who has left before they came is then found to have left.
  while (auto newcomer = listener_.accept()) {
    if (waiting_.size() < kMaxWaiting) {
      waiting_.push_back(std::move(*newcomer));
    } else {
      refuse(*newcomer, "too many connections wait that have not said Connect");
    }
  }
  if (client_) {
    const bool open = client_->flush() && client_->receive();
    while (client_ && take_request()) {
    }
    if (client_ && !open) drop("closed the connection");
  }
  waiting_.remove_if([&](Connection& newcomer) { return !greet(newcomer); });
}

// False when the connection is not kept among those that wait.
bool Port::greet(Connection& newcomer) {
  if (client_) {
    refuse(newcomer, client_->name() + " is connected, and only one client is served at a time");
    return false;
  }
  if (!newcomer.receive()) return false;
  const auto in = newcomer.received();
  const std::size_t size = header_size_ + 4;
  if (in.size() >= header_size_) {
    const Header header = read_header(in);
    if (header.command != 0 || header.size != size) {
      refuse(newcomer, "its first message has command " + std::to_string(header.command) + " and size " +
                           std::to_string(header.size) + ", where Connect has command 0 and size " +
                           std::to_string(size));
      return false;
    }
  }
  if (in.size() < size) {
    if (newcomer.waits() < kPatience) return true;
    refuse(newcomer, "only " + std::to_string(in.size()) + " of the " + std::to_string(size) + " bytes of Connect came");
    return false;
  }
  fci::Connect request;  // the same in every version, and for the gripper
  fci::read(fci::kOldestVersion, in.subspan(header_size_), request);
  const std::uint32_t id = read_header(in).id;
  newcomer.consume(size);
  if (connect(newcomer, id, request.version, request.udp_port)) {
    spdlog::info("{}: {} connected, protocol version {}", title_, newcomer.name(), request.version);
    client_ = std::move(newcomer);
  } else {
    refuse(newcomer, "it speaks protocol version " + std::to_string(request.version) + ", which this one does not");
  }
  return false;
}

// One request, if all of it is there.
bool Port::take_request() {
  const auto in = client_->received();
  const bool late = client_->waits() >= kPatience;
  if (in.size() < header_size_) {
    if (!in.empty() && late) drop("was dropped: after " + std::to_string(in.size()) + " bytes of a message it fell silent");
    return false;
  }
  const Header header = read_header(in);
  const std::string_view request = request_name(header.command);
  if (request.empty() || header.size < header_size_ || header.size > max_size_) {
    drop("was dropped: it sent a message with command " + std::to_string(header.command) + " and size " +
         std::to_string(header.size) + ", which its protocol version does not have");
    return false;
  }
  if (in.size() < header.size) {
    if (late) {
      drop("was dropped: after " + std::to_string(in.size()) + " of " + std::to_string(header.size) + " bytes of " +
           std::string(request) + " it fell silent");
    }
    return false;
  }
  const std::vector<std::byte> body(in.begin() + static_cast<std::ptrdiff_t>(header_size_), in.begin() + header.size);
  client_->consume(header.size);
  if (handle(header, body)) return true;
  drop("was dropped: its " + std::string(request) + " has " + std::to_string(header.size) +
       " bytes, which it has in no message of its protocol version");
  return false;
}

void Port::drop(const std::string& why) {
  spdlog::info("{}: {} {}", title_, client_->name(), why);
  client_.reset();
  gone();
}

void Port::refuse(const Connection& newcomer, const std::string& why) const {
  spdlog::warn("{}: refused {}: {}", title_, newcomer.name(), why);
}

}  // namespace sim
