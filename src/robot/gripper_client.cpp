#include "robot/gripper_client.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

namespace robot {
namespace {

using namespace std::chrono_literals;
namespace gripper = fci::gripper;

constexpr auto kStateAge = 1s;
constexpr double kStill = 1e-4;       // m, by which the width of fingers that rest may vary
constexpr double kLongestWay = 0.1;  // m, of the width
constexpr std::size_t kStatusSize = sizeof(std::uint16_t);
constexpr std::size_t kMaxResponse = 4096;  // bytes: above this it is garbage

const std::string kRemedy =
    "Check that a hand is mounted and set up in Desk (for a simulated arm: that fci-sim runs at this address).";

std::chrono::duration<double> time_to_move(double speed) {
  return std::chrono::duration<double>(std::clamp(kLongestWay / speed, 0., 1000.));
}

template <class Request>
std::size_t write_request(std::uint32_t id, const Request& request, std::span<std::byte> out) {
  const std::size_t size = gripper::kHeaderSize + fci::size_of<Request>(gripper::kVersion);
  fci::write(gripper::kVersion, gripper::Header{Request::kCommand, id, static_cast<std::uint32_t>(size)}, out);
  fci::write(gripper::kVersion, request, out.subspan(gripper::kHeaderSize));
  return size;
}

}  // namespace

GripperClient::GripperClient(const std::string& address, const GripperTimes& times)
    : peer_("the hand", address, gripper::kPort, kRemedy), times_(times) {
  const auto deadline = Clock::now() + times_.connect;
  tcp_ = peer_.connect(deadline);
  std::uint16_t port = 0;
  udp_ = peer_.udp(tcp_, port);
  wake_ = Socket(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));

  std::array<std::byte, 64> bytes;
  peer_.send(tcp_, std::span(bytes).first(write_request(0, gripper::Connect{gripper::kVersion, port}, bytes)),
             deadline);

  const std::string what = "its answer to Connect";
  std::array<std::byte, gripper::kHeaderSize> head;
  peer_.receive(tcp_, head, what, deadline);
  gripper::Header header;
  fci::read(gripper::kVersion, head, header);
  const std::size_t least = fci::size_of<gripper::ConnectResponse>(gripper::kVersion);
  if (header.command != gripper::Command::kConnect || header.size < gripper::kHeaderSize + least ||
      header.size > gripper::kHeaderSize + bytes.size()) {
    throw ConnectError("What answers at " + peer_.endpoint() + " is no hand: instead of the answer to Connect (" +
                       std::to_string(gripper::kHeaderSize + least) + " bytes) came a message with command " +
                       std::to_string(static_cast<unsigned>(header.command)) + " and size " +
                       std::to_string(header.size) + ". Check the address.");
  }
  const auto body = std::span(bytes).first(header.size - gripper::kHeaderSize);
  peer_.receive(tcp_, body, what, deadline);
  gripper::ConnectResponse response;
  fci::read(gripper::kVersion, body, response);
  if (response.status != gripper::ConnectStatus::kSuccess) {
    throw ConnectError("The hand at " + peer_.endpoint() + " speaks protocol version " +
                       std::to_string(response.version) + "; this program speaks " +
                       std::to_string(gripper::kVersion) + " (Panda system 3.0 and later).");
  }
  reader_ = std::thread([this] { run(); });
}

GripperClient::~GripperClient() {
  cancel();
  reader_.join();
}

GripperClient::Outcome GripperClient::homing() { return call(gripper::Homing{}, times_.homing); }
GripperClient::Outcome GripperClient::stop() { return call(gripper::Stop{}, 0s); }
GripperClient::Outcome GripperClient::grasp(const gripper::Grasp& request) { return call(request, time_to_move(request.speed)); }
GripperClient::Outcome GripperClient::move(double width, double speed) {
  return call(gripper::Move{width, speed}, time_to_move(speed));
}

// `motion`: what the fingers need at most.
template <class Request>
GripperClient::Outcome GripperClient::call(const Request& request, std::chrono::duration<double> motion) {
  const auto deadline = Clock::now() + times_.answer + std::chrono::ceil<std::chrono::milliseconds>(motion);
  std::unique_lock lock(mutex_);
  if (cancelled_) return Outcome::kCancelled;
  if (!lost_.empty()) return Outcome::kLost;

  Call call{next_id_++, std::nullopt};
  waiting_.push_back(&call);
  std::array<std::byte, 64> bytes;
  const std::size_t size = write_request(call.id, request, bytes);
  lock.unlock();
  try {
    const std::lock_guard sending(sending_);
    peer_.send(tcp_, std::span(bytes).first(size), Clock::now() + times_.connect);
  } catch (const ConnectError& error) {
    lose(error.what());
  }
  lock.lock();
  bool over = false, is_late = false;
  for (auto until = deadline; !over && !is_late; until = moved_ + times_.answer) {
    over = answered_.wait_until(lock, until, [&] { return call.outcome || cancelled_ || !lost_.empty(); });
    is_late = moved_ + times_.answer < Clock::now();
  }
  std::erase(waiting_, &call);
  if (!over) return Outcome::kSilent;
  return call.outcome.value_or(cancelled_ ? Outcome::kCancelled : Outcome::kLost);
}

void GripperClient::cancel() {
  {
    const std::lock_guard lock(mutex_);
    cancelled_ = true;
  }
  answered_.notify_all();
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(wake_.fd(), &one, sizeof(one));
}

std::optional<gripper::State> GripperClient::state() const {
  const std::lock_guard lock(mutex_);
  if (!lost_.empty() || Clock::now() - state_time_ > kStateAge) return std::nullopt;
  return state_;
}

std::string GripperClient::lost() const {
  const std::lock_guard lock(mutex_);
  return lost_;
}

void GripperClient::lose(const std::string& why) {
  {
    const std::lock_guard lock(mutex_);
    if (lost_.empty()) lost_ = why;
  }
  answered_.notify_all();
}

void GripperClient::run() {
  std::array<pollfd, 3> fds = {{{wake_.fd(), POLLIN, 0}, {tcp_.fd(), POLLIN, 0}, {udp_.fd(), POLLIN, 0}}};
  for (;;) {
    if (::poll(fds.data(), fds.size(), -1) < 0) continue;
    if (fds[0].revents != 0) return;
    if (fds[2].revents != 0) read_udp();
    if (fds[1].revents != 0 && !read_tcp()) return;
  }
}

void GripperClient::read_udp() {
  std::array<std::byte, gripper::kStateSize + 1> datagram;
  sockaddr_in from{};
  socklen_t from_size = sizeof(from);
  const ssize_t size = ::recvfrom(udp_.fd(), datagram.data(), datagram.size(), MSG_DONTWAIT,
                                  reinterpret_cast<sockaddr*>(&from), &from_size);
  if (size != static_cast<ssize_t>(gripper::kStateSize) || !peer_.owns(from)) return;
  gripper::State state;
  fci::read(gripper::kVersion, datagram, state);
  if (!std::isfinite(state.width) || !std::isfinite(state.max_width)) return;
  const std::lock_guard lock(mutex_);
  if (state_ && state.message_id <= state_->message_id) return;
  state_ = state;
  state_time_ = Clock::now();
  if (std::abs(state.width - moved_to_) > kStill) {
    moved_ = state_time_;
    moved_to_ = state.width;
  }
}

bool GripperClient::read_tcp() {
  std::array<std::byte, 512> bytes;
  const ssize_t got = ::recv(tcp_.fd(), bytes.data(), bytes.size(), MSG_DONTWAIT);
  if (got < 0 && (errno == EAGAIN || errno == EINTR)) return true;
  if (got <= 0) {
    lose("The hand closed the connection.");
    return false;
  }
  in_.insert(in_.end(), bytes.begin(), bytes.begin() + got);
  while (in_.size() >= gripper::kHeaderSize + kStatusSize) {
    gripper::Header header;
    fci::read(gripper::kVersion, in_, header);
    if (header.size < gripper::kHeaderSize + kStatusSize || header.size > kMaxResponse) {
      lose("The hand sent garbage: a response of " + std::to_string(header.size) + " bytes.");
      return false;
    }
    if (in_.size() < header.size) break;
    std::uint16_t status;
    std::memcpy(&status, in_.data() + gripper::kHeaderSize, sizeof(status));
    answer(header.command_id, status);
    in_.erase(in_.begin(), in_.begin() + header.size);
  }
  return true;
}

void GripperClient::answer(std::uint32_t id, std::uint16_t status) {
  static constexpr std::array kOutcomes = {Outcome::kSuccess, Outcome::kFailed, Outcome::kUnsuccessful,
                                           Outcome::kAborted};
  {
    const std::lock_guard lock(mutex_);
    const auto call = std::find_if(waiting_.begin(), waiting_.end(), [&](const Call* c) { return c->id == id; });
    if (call == waiting_.end()) return;
    (*call)->outcome = status < kOutcomes.size() ? kOutcomes[status] : Outcome::kFailed;
  }
  answered_.notify_all();
}

}  // namespace robot
