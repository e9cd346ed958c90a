#include "robot/fci_driver.hpp"

#include <sched.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <ctime>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

namespace robot {
namespace {

using namespace std::chrono_literals;

constexpr int kTcpChecks = 10;        // looks for a closed connection in the time in which no states come
constexpr int kTcpEvery = 8;          // polls between looks at TCP while no answer is due
constexpr std::int64_t kShortWait = 500'000;  // ns, for a state: nobody paces this arm
constexpr std::int64_t kPolling = 25'000;     // ns, as most answers in lockstep take
constexpr int kPollingPause = 3;              // waits without polling after it was in vain
constexpr std::size_t kMinResponse = fci::kHeaderSize + 1;  // bytes: a status at least
constexpr std::size_t kMaxResponse = 64 << 20;              // bytes: above this it is garbage

const std::string kRemedy =
    "Check that the arm is on, that its address is right, and that joints are unlocked and FCI is activated in Desk "
    "(for a simulated arm: that fci-sim runs at this address).";

std::int64_t now_ns() {
  timespec now;
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1'000'000'000ll + now.tv_nsec;
}

template <class T>
bool finite(const T& value) {
  if constexpr (std::is_floating_point_v<T>) {
    return std::isfinite(value);
  } else {
    return std::all_of(value.begin(), value.end(), [](double element) { return std::isfinite(element); });
  }
}

// Of a state what the loop and the parts of skills compute with. What else is no number is passed on as it is, and costs nobody
// the state.
bool usable(const fci::RobotState& s) {
  const auto all = [](const auto&... values) { return (finite(values) && ...); };
  return all(s.q, s.dq, s.q_d, s.dq_d, s.ddq_d, s.tau_J_d, s.tau_ext_hat_filtered, s.O_T_EE, s.O_T_EE_c, s.F_T_EE, s.EE_T_K,
             s.O_F_ext_hat_K, s.K_F_ext_hat_K, s.O_ddP_O, s.m_ee, s.I_ee, s.F_x_Cee, s.m_load, s.I_load, s.F_x_Cload,
             s.joint_contact, s.cartesian_contact, s.joint_collision, s.cartesian_collision, s.control_command_success_rate);
}

bool known_modes(const fci::RobotState& state) {
  return state.motion_generator_mode <= fci::MotionGeneratorMode::kNone &&
         state.controller_mode <= fci::ControllerMode::kOther &&
         state.robot_mode <= fci::RobotMode::kAutomaticErrorRecovery;
}

std::string supported() {
  return std::to_string(fci::kOldestVersion) + " to " + std::to_string(fci::kNewestVersion);
}

}  // namespace

std::unique_ptr<FciDriver> FciDriver::connect(const std::string& address, const FciTimes& times) {
  const Peer peer("the robot", address, fci::kRobotPort, kRemedy);
  fci::Version offered = fci::kNewestVersion;
  for (;;) {
    const auto deadline = Clock::now() + times.connect;
    Socket tcp = peer.connect(deadline);
    std::uint16_t port = 0;
    Socket udp = peer.udp(tcp, port);

    std::array<std::byte, fci::kMaxRequestSize> request;
    // Connect has the same bytes in every version.
    const std::size_t size = fci::write_request(offered, 0, fci::Connect{offered, port}, std::span(request));
    peer.send(tcp, std::span(request).first(size), deadline);

    std::array<std::byte, fci::kHeaderSize> head;
    peer.receive(tcp, head, "its answer to Connect", deadline);
    fci::Header header;
    fci::read(offered, head, header);
    std::array<std::byte, 64> body;
    const std::size_t least = fci::size_of<fci::ConnectResponse>(offered);
    if (header.command != 0 || header.size < fci::kHeaderSize + least ||
        header.size > fci::kHeaderSize + body.size()) {
      throw ConnectError("What answers at " + peer.endpoint() + " is no robot: instead of the answer to Connect (" +
                         std::to_string(fci::kHeaderSize + least) + " bytes) came a message with command " +
                         std::to_string(header.command) + " and size " + std::to_string(header.size) +
                         ". Check the address.");
    }
    const auto body_bytes = std::span(body).first(header.size - fci::kHeaderSize);
    peer.receive(tcp, body_bytes, "its answer to Connect", deadline);
    fci::ConnectResponse response;
    fci::read(offered, body_bytes, response);

    const auto status = fci::status_of(offered, fci::Command::kConnect, response.status);
    if (status == fci::Status::kSuccess) {
      std::unique_ptr<FciDriver> driver(new FciDriver(peer, std::move(tcp), std::move(udp), times));
      driver->version_ = driver->settle_version(offered, response.version, Clock::now() + times.connect);
      driver->command_size_ = fci::size_of<fci::RobotCommand>(driver->version_);
      driver->fetch_robot_model(Clock::now() + times.model);
      return driver;
    }
    if (status != fci::Status::kIncompatibleLibraryVersion) {
      throw ConnectError("What answers at " + peer.endpoint() + " is no robot: its answer to Connect has status " +
                         std::to_string(response.status) + ", which is not defined. Check the address.");
    }
    if (response.version < fci::kOldestVersion || response.version > fci::kNewestVersion) {
      throw ConnectError("The robot at " + address + " speaks protocol version " + std::to_string(response.version) +
                         "; this program speaks " + supported() +
                         ". Update the system of the robot (5: Panda 4.2, 10: FR3 5.9) or this program.");
    }
    if (offered != fci::kNewestVersion || response.version == offered) {
      throw ConnectError("The robot at " + address + " says that it speaks protocol version " +
                         std::to_string(response.version) + ", and refused version " + std::to_string(offered) +
                         ", which it had named itself. Restart it.");
    }
    offered = response.version;
  }
}

FciDriver::FciDriver(Peer peer, Socket tcp, Socket udp, const FciTimes& times)
    : peer_(std::move(peer)), times_(times), tcp_(std::move(tcp)), udp_(std::move(udp)), next_id_(1) {
  for (int i = 0; i < kDatagrams; ++i) {
    in_.pieces[i] = {in_.bytes[i].data(), kDatagramRoom};
    in_.headers[i] = {};
    in_.headers[i].msg_hdr.msg_iov = &in_.pieces[i];
    in_.headers[i].msg_hdr.msg_iovlen = 1;
    in_.headers[i].msg_hdr.msg_name = &in_.from[i];
  }
  const auto check = std::chrono::microseconds(times_.silence) / kTcpChecks;
  const timeval timeout{check / 1s, check % 1s / 1us};
  ::setsockopt(udp_.fd(), SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof(timeout));
}

// Some peers accept any version and name one in their answer that they do not mean; the size of the states
// cannot lie.
fci::Version FciDriver::settle_version(std::uint16_t offered, std::uint16_t answered, Clock::time_point deadline) {
  const std::size_t float_size = fci::size_of<fci::RobotState>(fci::kFloatStateVersion);
  const std::size_t double_size = fci::size_of<fci::RobotState>(fci::kOldestVersion);
  std::string came;  // sizes of what was no state
  while (wait_readable(udp_.fd(), deadline)) {
    std::array<std::byte, kDatagramRoom> datagram;
    sockaddr_in from{};
    socklen_t from_size = sizeof(from);
    const ssize_t size = ::recvfrom(udp_.fd(), datagram.data(), datagram.size(), MSG_TRUNC | MSG_DONTWAIT,
                                    reinterpret_cast<sockaddr*>(&from), &from_size);
    if (size < 0) continue;
    if (!peer_.owns(from)) {
      ++counters_->foreign;
      continue;
    }
    const auto bytes = static_cast<std::size_t>(size);
    fci::Version version = 0;
    if (bytes == float_size) {
      version = fci::kFloatStateVersion;
    } else if (bytes == double_size) {
      version = offered < fci::kFloatStateVersion ? offered : answered;
      if (version < fci::kOldestVersion || version >= fci::kFloatStateVersion) {
        throw ConnectError("The robot at " + peer_.endpoint() + " contradicts itself: it accepted protocol version " +
                           std::to_string(offered) + " and named " + std::to_string(answered) +
                           ", but its states have " + std::to_string(bytes) + " bytes, as versions 5 to 9 have. " +
                           "Which of these it means cannot be known; start it with one version.");
      }
    } else {
      ++counters_->wrong_size;
      if (came.size() < 100) came += (came.empty() ? "" : ", ") + std::to_string(bytes);
      continue;
    }
    version_ = version;
    state_size_ = bytes;
    if (!read_state(datagram.data(), first_state_)) {
      if (came.size() < 100) came += (came.empty() ? "" : ", ") + std::to_string(bytes) + " (values not finite)";
      continue;
    }
    newest_ = first_state_.message_id;
    any_state_ = true;
    commands_to_ = from;
    return version;
  }
  if (!came.empty()) {
    throw ConnectError("The robot at " + peer_.endpoint() + " accepted the connection, but sends no states: expected " +
                       std::to_string(float_size) + " bytes (version 10) or " + std::to_string(double_size) +
                       " (versions 5 to 9), received datagrams of " + came + " bytes.");
  }
  if (counters_->foreign > 0) {
    throw ConnectError("The robot at " + peer_.endpoint() + " accepted the connection, but datagrams come from other "
                       "addresses than its own. Give the address that it sends from.");
  }
  throw ConnectError("The robot at " + peer_.endpoint() +
                     " accepted the connection, but no states arrive over UDP. Check that no firewall of this "
                     "computer drops them.");
}

void FciDriver::fetch_robot_model(Clock::time_point deadline) {
  if (!fci::command_id(version_, fci::Command::kGetRobotModel)) return;
  std::array<std::byte, fci::kMaxRequestSize> request;
  const std::uint32_t id = next_id_++;
  const std::size_t size = fci::write_request(version_, id, fci::GetRobotModel{}, std::span(request));
  peer_.send(tcp_, std::span(request).first(size), deadline);

  const std::string what = "its model (GetRobotModel)";
  std::array<std::byte, fci::kHeaderSize> head;
  peer_.receive(tcp_, head, what, deadline);
  fci::Header header;
  fci::read(version_, head, header);
  if (header.command_id != id || header.size < kMinResponse || header.size > kMaxResponse) {
    throw ConnectError("The robot at " + peer_.endpoint() + " answered the request for its model with command " +
                       std::to_string(header.command) + ", id " + std::to_string(header.command_id) + ", size " +
                       std::to_string(header.size) + "; expected id " + std::to_string(id) + " and at least " +
                       std::to_string(kMinResponse) + " bytes.");
  }
  std::vector<std::byte> body(header.size - fci::kHeaderSize);
  peer_.receive(tcp_, body, what, deadline);
  if (body[0] == std::byte{0}) robot_model_.assign(reinterpret_cast<const char*>(body.data()) + 1, body.size() - 1);
}

std::string FciDriver::Counters::text() const {
  std::string text;
  for (const auto& [count, what] : {std::pair{&wrong_size, "datagrams of the wrong size"},
                                    std::pair{&bad_values, "states with values that are no numbers, or unknown modes"},
                                    std::pair{&old, "states that were not newer than the last"},
                                    std::pair{&foreign, "datagrams from another address"},
                                    std::pair{&unsent, "commands that the network did not take"},
                                    std::pair{&unasked, "answers that nobody had asked for"}}) {
    if (const std::uint64_t number = count->load(); number > 0) {
      text += (text.empty() ? "" : ", ") + std::to_string(number) + " " + what;
    }
  }
  return text;
}

void FciDriver::lose(const char* why) noexcept {
  if (lost_.load() == nullptr) lost_ = why;
}

// Waits for a datagram and takes along what else there is: how many, or -1 after the socket's timeout. A simulated arm in
// lockstep answers sooner than a sleeping thread wakes: where the last wait was so short that nobody paces the arm, this
// one polls first, and lets it run if it waits for this processor; but for a thread with real-time priority, which would let
// no other run meanwhile.
int FciDriver::wait() noexcept {
  const std::int64_t began = now_ns();
  int datagrams = -1;
  if (pause_ > 0) {
    --pause_;
  } else if (short_wait_ && ::sched_getscheduler(0) == SCHED_OTHER) {
    do {
      datagrams = ::recvmmsg(udp_.fd(), in_.headers.data(), kDatagrams, MSG_DONTWAIT, nullptr);
      if (datagrams <= 0) ::sched_yield();
      received_ns_ = now_ns();
    } while (datagrams <= 0 && received_ns_ - began < kPolling);
    if (datagrams <= 0) pause_ = kPollingPause;
  }
  if (datagrams <= 0) {
    datagrams = ::recvmmsg(udp_.fd(), in_.headers.data(), kDatagrams, MSG_WAITFORONE, nullptr);
    received_ns_ = now_ns();
  }
  short_wait_ = received_ns_ - began < kShortWait;
  return datagrams;
}

Received FciDriver::receive(fci::RobotState& state) noexcept {
  const auto deadline = Clock::now() + times_.silence;
  int vain = 0;  // waits; one that a computer which stood still drew out is one
  while (vain < kTcpChecks) {
    if (lost_.load() != nullptr) return Received::kLost;
    for (int i = 0; i < kDatagrams; ++i) {
      in_.headers[i].msg_hdr.msg_namelen = sizeof(sockaddr_in);
      in_.headers[i].msg_hdr.msg_flags = 0;
    }
    const int datagrams = wait();
    if (datagrams > 0) {
      bool found = take_newest(datagrams, state);
      for (int full = datagrams; full == kDatagrams;) {  // away for long: drain the rest
        full = ::recvmmsg(udp_.fd(), in_.headers.data(), kDatagrams, MSG_DONTWAIT, nullptr);
        if (full > 0) found = take_newest(full, state) || found;
        if (Clock::now() > deadline) break;
      }
      if (found) return Received::kState;
      if (Clock::now() > deadline) break;
    } else {
      read_tcp();
      ++vain;
    }
  }
  return lost_.load() != nullptr ? Received::kLost : Received::kNothing;
}

// The state with the greatest message_id counts; what is no state, or came too late, is counted.
bool FciDriver::take_newest(int datagrams, fci::RobotState& state) noexcept {
  bool found = false;
  for (int i = 0; i < datagrams; ++i) {
    const mmsghdr& header = in_.headers[i];
    if (in_.from[i].sin_addr.s_addr != commands_to_.sin_addr.s_addr) {
      ++counters_->foreign;
      continue;
    }
    if (header.msg_len != state_size_ || (header.msg_hdr.msg_flags & MSG_TRUNC) != 0) {
      ++counters_->wrong_size;
      continue;
    }
    std::uint64_t message_id;
    std::memcpy(&message_id, in_.bytes[i].data(), sizeof(message_id));
    if (any_state_ && message_id <= newest_) {
      ++counters_->old;
      continue;
    }
    if (!read_state(in_.bytes[i].data(), state)) continue;
    found = any_state_ = true;
    newest_ = message_id;
    commands_to_ = in_.from[i];
  }
  return found;
}

bool FciDriver::read_state(const std::byte* datagram, fci::RobotState& state) noexcept {
  fci::Reader reader(version_, datagram);
  walk(reader, scratch_);
  if (!usable(scratch_) || !known_modes(scratch_)) {
    ++counters_->bad_values;
    return false;
  }
  state = scratch_;
  return true;
}

void FciDriver::send(const fci::RobotCommand& command) noexcept {
  std::array<std::byte, fci::kMaxCommandSize> bytes;
  fci::Writer writer(version_, bytes.data());
  walk(writer, command);
  const ssize_t sent = ::sendto(udp_.fd(), bytes.data(), command_size_, MSG_DONTWAIT | MSG_NOSIGNAL,
                                reinterpret_cast<const sockaddr*>(&commands_to_), sizeof(commands_to_));
  if (sent != static_cast<ssize_t>(command_size_)) ++counters_->unsent;
}

std::optional<std::uint32_t> FciDriver::post(const Request& request) noexcept {
  if (lost_.load() != nullptr || tcp_out_.size() - tcp_out_size_ < fci::kMaxRequestSize) return std::nullopt;
  const std::uint32_t id = next_id_;
  std::span<std::byte, fci::kMaxRequestSize> room(tcp_out_.data() + tcp_out_size_, fci::kMaxRequestSize);
  const std::size_t size =
      std::visit([&](const auto& body) { return fci::write_request(version_, id, body, room); }, request);
  if (size == 0) return std::nullopt;
  ++next_id_;
  OpenRequest& open = open_[id % kOpenRequests];
  if (open.due) --awaited_;
  open = {id, std::visit([](const auto& body) { return body.kCommand; }, request), true};
  ++awaited_;
  tcp_out_size_ += size;
  flush();
  return id;
}

// Hands the socket what it takes; the rest goes with the next call.
void FciDriver::flush() noexcept {
  while (tcp_out_size_ > 0) {
    const ssize_t sent = ::send(tcp_.fd(), tcp_out_.data(), tcp_out_size_, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent > 0) {
      tcp_out_size_ -= static_cast<std::size_t>(sent);
      std::memmove(tcp_out_.data(), tcp_out_.data() + sent, tcp_out_size_);
    } else {
      if (errno != EAGAIN && errno != EINTR) lose("the robot closed the TCP connection");
      return;
    }
  }
}

void FciDriver::read_tcp() noexcept {
  since_tcp_ = 0;
  const ssize_t got =
      ::recv(tcp_.fd(), tcp_in_.data() + tcp_in_size_, tcp_in_.size() - tcp_in_size_, MSG_DONTWAIT);
  if (got > 0) {
    tcp_in_size_ += static_cast<std::size_t>(got);
  } else if (got == 0 || (errno != EAGAIN && errno != EINTR)) {
    lose(got == 0 ? "the robot closed the TCP connection" : "the TCP connection broke");
  }
}

// Whether an answer is one to a request that is open; then it is closed, but for a Move, which is answered again at its end.
bool FciDriver::asked_for(std::uint32_t id, fci::Command command, fci::Status status) noexcept {
  OpenRequest& open = open_[id % kOpenRequests];
  if (id == 0 || open.id != id || open.command != command) return false;
  if (open.due) --awaited_;
  open.due = false;
  if (status != fci::Status::kMotionStarted) open.id = 0;
  return true;
}

std::optional<Answer> FciDriver::poll() noexcept {
  flush();
  const auto drop = [&](std::size_t bytes) {
    tcp_in_size_ -= bytes;
    std::memmove(tcp_in_.data(), tcp_in_.data() + bytes, tcp_in_size_);
  };
  bool read = awaited_ == 0 && ++since_tcp_ < kTcpEvery;  // already, or not now
  for (;;) {
    const std::size_t skipped = std::min<std::uint64_t>(skip_, tcp_in_size_);
    if (skipped > 0) {
      skip_ -= skipped;
      drop(skipped);
    }
    if (tcp_in_size_ >= kMinResponse) {
      fci::Header header;
      fci::read(version_, tcp_in_, header);
      const auto command = fci::command_of(version_, header.command);
      if (!command || header.size < kMinResponse || header.size > kMaxResponse) {
        lose("the robot sent garbage over TCP: a response with an impossible header");
        return std::nullopt;
      }
      const auto byte = std::to_integer<std::uint8_t>(tcp_in_[fci::kHeaderSize]);
      const auto status = fci::status_of(version_, *command, byte);
      if (!status) {
        lose("the robot sent garbage over TCP: a status that its protocol version does not have");
        return std::nullopt;
      }
      drop(kMinResponse);
      skip_ = header.size - kMinResponse;
      if (!asked_for(header.command_id, *command, *status)) {
        ++counters_->unasked;
        continue;
      }
      return Answer{header.command_id, *command, *status};
    }
    if (read || lost_.load() != nullptr) return std::nullopt;
    read = true;
    read_tcp();
  }
}

}  // namespace robot
