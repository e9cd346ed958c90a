// From a state datagram out to its command datagram in, as an arm sees it: a sender paced at 1 kHz on one processor,
// the loop under Cartesian impedance blocking on another. By turns in the same run the sender talks to a bare UDP echo
// on the loop's processor (1377 B in, 371 B out), which shows what the network and the kernel cost.
//   turnaround_minus_echo_us_p50   median of the one less median of the other

#include <arpa/inet.h>
#include <pthread.h>
#include <sched.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "models/arm.hpp"
#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/loop.hpp"
#include "realtime/trajectories/min_jerk_pose.hpp"
#include "robot/fci_driver.hpp"
#include "server/realtime_setup.hpp"

namespace {

using namespace realtime;

constexpr int kBlocks = 40;         // of each peer
constexpr int kBlock = 100;         // cycles; the other's silence must stay well below the driver's second
constexpr int kAttempts = 10;
constexpr int kWarmUp = 10;         // cycles of a block that do not count
constexpr std::int64_t kPeriod = 1'000'000;   // ns
constexpr std::int64_t kPatience = 900'000'000;  // ns for an answer
constexpr std::size_t kStateSize = 1377, kCommandSize = 371;  // bytes, version 10
constexpr fci::Version kVersion = 10;

std::int64_t now_ns() {
  timespec now;
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1'000'000'000ll + now.tv_nsec;
}

void sleep_until(std::int64_t ns) {
  const timespec until{ns / 1'000'000'000, ns % 1'000'000'000};
  ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
}

void pin(int processor) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(processor, &set);
  ::pthread_setaffinity_np(::pthread_self(), sizeof(set), &set);
}

double percentile(std::vector<double> values, double share) {
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

sockaddr_in at(const std::string& address, std::uint16_t port) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_port = htons(port);
  ::inet_pton(AF_INET, address.c_str(), &out.sin_addr);
  return out;
}

int bound(int type, const std::string& address, std::uint16_t port) {
  const int fd = ::socket(AF_INET, type, 0);
  const sockaddr_in name = at(address, port);
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&name), sizeof(name)) == 0) return fd;
  ::close(fd);
  return -1;
}

// As much of an arm of version 10 as the loop needs to run a motion: it stands at home, and its modes match.
class Arm {
 public:
  Arm() {
    std::random_device random;
    std::uniform_int_distribution<> part(1, 254);
    for (int tries = 0; listening_ < 0 && tries < 100; ++tries) {
      address = "127." + std::to_string(part(random)) + "." + std::to_string(part(random)) + ".1";
      listening_ = bound(SOCK_STREAM, address, fci::kRobotPort);
    }
    ::listen(listening_, 1);
    udp = bound(SOCK_DGRAM, address, 0);
    state.message_id = 1;
    state.robot_mode = fci::RobotMode::kIdle;
    for (int i = 0; i < 7; ++i) state.q[i] = state.q_d[i] = models::kHome[i];
    Model model(models::urdf(models::arm("fr3"), kVersion));
    Eigen::Matrix4d::Map(state.O_T_EE.data()) = model.O_T_EE(Vector7::Map(models::kHome.data())).matrix();
  }

  // Takes the one client and its Connect and GetRobotModel.
  void serve_connect() {
    tcp_ = ::accept(listening_, nullptr, nullptr);
    fci::Connect connect;
    answer(&connect, [](auto) { return std::vector<std::byte>{std::byte{0}, std::byte{kVersion}, std::byte{0}}; });
    sockaddr_in peer{};
    socklen_t size = sizeof(peer);
    ::getpeername(tcp_, reinterpret_cast<sockaddr*>(&peer), &size);
    client = peer;
    client.sin_port = htons(connect.udp_port);
    send_state();
    answer(nullptr, [](auto) { return std::vector<std::byte>{std::byte{1}}; });  // has no model
  }

  // Takes Move, from when on the modes match.
  void serve_move() {
    fci::Move move;
    fci::Header header;
    while (state.robot_mode != fci::RobotMode::kMove) {
      send_state();
      sleep_until(now_ns() + kPeriod);
      std::array<std::byte, 512> bytes;
      if (::recv(tcp_, bytes.data(), bytes.size(), MSG_DONTWAIT) <= 0) continue;
      fci::read(kVersion, bytes, header);
      fci::read(kVersion, std::span<const std::byte>(bytes).subspan(fci::kHeaderSize), move);
      if (fci::command_of(kVersion, header.command) != fci::Command::kMove) throw std::runtime_error("no Move");
      state.robot_mode = fci::RobotMode::kMove;
      state.controller_mode = move.controller_mode;
      state.motion_generator_mode = move.motion_generator_mode;
      respond(header, {std::byte{1}});
    }
  }

  void send_state() {
    std::array<std::byte, kStateSize> bytes;
    fci::write(kVersion, state, bytes);
    ++state.message_id;
    ::sendto(udp, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&client), sizeof(client));
  }

  std::string address;
  int udp = -1;
  sockaddr_in client{};
  fci::RobotState state;

 private:
  template <class Body>
  void answer(fci::Connect* connect, Body body) {
    std::array<std::byte, 64> bytes;
    fci::Header header;
    ::recv(tcp_, bytes.data(), fci::kHeaderSize, MSG_WAITALL);
    fci::read(kVersion, bytes, header);
    if (header.size > fci::kHeaderSize) ::recv(tcp_, bytes.data(), header.size - fci::kHeaderSize, MSG_WAITALL);
    if (connect != nullptr) fci::read(kVersion, bytes, *connect);
    respond(header, body(0));
  }
  void respond(fci::Header header, const std::vector<std::byte>& body) {
    std::vector<std::byte> bytes(fci::kHeaderSize);
    bytes.insert(bytes.end(), body.begin(), body.end());
    header.size = static_cast<std::uint32_t>(bytes.size());
    fci::write(kVersion, header, bytes);
    ::send(tcp_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }

  int listening_ = -1, tcp_ = -1;
};

std::unique_ptr<Skill> endless_skill(const models::Limits& limits, const fci::RobotState& state) {
  auto skill = std::make_unique<Skill>();
  skill->id = 1;
  const Eigen::Matrix4d T = Eigen::Matrix4d::Map(state.O_T_EE.data());
  skill->trajectory = std::make_unique<MinJerkPose>(
      MinJerkPose::Parameters{T.topRightCorner<3, 1>() + Vector3(0.1, 0.1, 0),
                              Eigen::Quaterniond(Eigen::Matrix3d(T.topLeftCorner<3, 3>())), 60},
      limits);
  skill->controller = std::make_unique<CartesianImpedance>(CartesianImpedance::Parameters{
      Vector3::Constant(600), Vector3::Constant(50), 1, 10});
  skill->mode = skill->controller->mode(ReferenceKind::kCartesian);
  return skill;
}

constexpr double kNoAnswer = -1;

// Time until the answer of kCommandSize bytes, us.
template <class Send>
double turnaround(int fd, Send send) {
  std::array<std::byte, 2048> bytes;
  const std::int64_t start = now_ns();
  send();
  for (;;) {
    const ssize_t size = ::recv(fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
    const std::int64_t now = now_ns();
    if (size == static_cast<ssize_t>(kCommandSize)) return static_cast<double>(now - start) * 1e-3;
    if (now - start > kPatience) return kNoAnswer;
  }
}

int run() {
  const int processors = static_cast<int>(std::thread::hardware_concurrency());
  const int ours = 0, theirs = processors > 1 ? 1 : 0;

  Arm arm;
  std::thread connecting([&] { arm.serve_connect(); });
  const auto driver = robot::FciDriver::connect(arm.address);
  connecting.join();

  const models::Limits& limits = models::limits(models::arm("fr3"), kVersion);
  Model model(models::urdf(models::arm("fr3"), kVersion));
  Door door;
  Loop loop(*driver, model, limits, {}, door);
  door.next.put(endless_skill(limits, arm.state));
  std::thread looping([&] {
    server::RealtimeReport report;
    server::prepare_thread(0, theirs, true, report);
    loop.run();
  });

  const int echo = bound(SOCK_DGRAM, arm.address, 0);
  sockaddr_in echo_address{};
  socklen_t size = sizeof(echo_address);
  ::getsockname(echo, reinterpret_cast<sockaddr*>(&echo_address), &size);
  const int own = bound(SOCK_DGRAM, arm.address, 0);
  const std::array<std::byte, kStateSize> state_sized{};
  std::thread echoing([&] {
    server::RealtimeReport report;
    server::prepare_thread(0, theirs, true, report);
    std::array<std::byte, 2048> bytes;
    for (;;) {
      sockaddr_in from{};
      socklen_t from_size = sizeof(from);
      const ssize_t got =
          ::recvfrom(echo, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&from), &from_size);
      if (got != static_cast<ssize_t>(kStateSize)) return;
      ::sendto(echo, bytes.data(), kCommandSize, 0, reinterpret_cast<sockaddr*>(&from), from_size);
    }
  });

  const auto end = [&] {
    ::sendto(own, state_sized.data(), 1, 0, reinterpret_cast<sockaddr*>(&echo_address), sizeof(echo_address));
    echoing.join();
    door.quit = true;
    looping.join();  // the arm is silent now: connection lost
    while (Skill* const* skill = door.retired.front()) {
      delete *skill;
      door.retired.pop();
    }
  };

  pin(ours);
  arm.serve_move();
  bridge::RingReader<Record> records(door.records);
  std::vector<double> of_loop, of_echo, compute;
  const auto collect = [&](bool counts) {
    for (Record record; records.next(record);) {
      if (counts && record.compute_ns > 0) compute.push_back(static_cast<double>(record.compute_ns) * 1e-3);
    }
  };
  for (int block = 0; block < 2 * kBlocks; ++block) {
    std::int64_t next = now_ns() + kPeriod;
    for (int i = 0; i < kBlock; ++i, next += kPeriod) {
      sleep_until(next);
      double time = 0;
      if (block % 2 == 0) {
        time = turnaround(arm.udp, [&] { arm.send_state(); });
      } else {
        time = turnaround(own, [&] {
          ::sendto(own, state_sized.data(), state_sized.size(), 0, reinterpret_cast<sockaddr*>(&echo_address),
                   sizeof(echo_address));
        });
      }
      if (time == kNoAnswer) {
        end();
        throw std::runtime_error("an answer did not come");
      }
      if (i >= kWarmUp) (block % 2 == 0 ? of_loop : of_echo).push_back(time);
      collect(i >= kWarmUp);
    }
  }

  end();

  for (const auto& [name, values] : {std::pair{"loop", &of_loop}, {"echo", &of_echo}, {"compute", &compute}}) {
    std::fprintf(stderr, "%-8s %6zu cycles: p50 %7.1f us, p99 %7.1f us, worst %8.1f us\n", name, values->size(),
                 percentile(*values, 0.5), percentile(*values, 0.99), percentile(*values, 1));
  }
  std::printf("{\"turnaround_minus_echo_us_p50\": %.2f}\n", percentile(of_loop, 0.5) - percentile(of_echo, 0.5));
  return EXIT_SUCCESS;
}

}  // namespace

int main() {
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    try {
      return run();
    } catch (const std::exception& error) {  // a computer that stands still for a second loses the robot
      std::fprintf(stderr, "turnaround: %s\n", error.what());
    }
  }
  return EXIT_FAILURE;
}
