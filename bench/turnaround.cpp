// From a state datagram out to its command datagram in, as an arm sees it: a sender paced at 1 kHz on one processor,
// the loop under Cartesian impedance blocking on another. By turns in the same run the sender talks to franky-control,
// whose libfranka runs its own Cartesian impedance on the loop's processor, and to a bare UDP echo there (1377 B in,
// 371 B out), which shows what the network and the kernel cost. All three have the same priority.
//   turnaround_minus_echo_us_p50   median of the loop less median of the echo
//   turnaround_ratio_franky_p50    median of the loop over that of franky-control 2.0.0

#include <arpa/inet.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bench/percentile.hpp"
#include "models/arm.hpp"
#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/loop.hpp"
#include "realtime/trajectories/min_jerk_pose.hpp"
#include "robot/fci_driver.hpp"
#include "server/realtime_setup.hpp"
#include "tests/child.hpp"

namespace {

using namespace realtime;

constexpr int kBlocks = 40;         // of each peer
constexpr int kBlock = 100;         // cycles; the others' silence must stay well below a client's second
constexpr int kAttempts = 10;
constexpr int kWarmUp = 10;         // cycles of a block that do not count
constexpr std::int64_t kPeriod = 1'000'000;   // ns
constexpr std::int64_t kPatience = 900'000'000;  // ns for an answer
constexpr std::size_t kStateSize = 1377, kCommandSize = 371;  // bytes, version 10
constexpr fci::Version kVersion = 10;
constexpr int kPeerStart = 120;  // s, with what must be installed for it

// A motion that goes on for longer than this program.
constexpr const char* kPeer = R"(
import sys, time, franky
robot = franky.Robot(sys.argv[1], realtime_config=franky.RealtimeConfig.Ignore)
goal = franky.Affine([0.1, 0.1, 0])
robot.move(franky.CartesianImpedanceMotion(goal, target_type=franky.ReferenceType.Relative, translational_stiffness=600),
           asynchronous=True)
time.sleep(600)
)";

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

// As much of an arm of version 10 as a client needs to run a motion: it stands at home, takes every setting, and its
// modes match what a Move asks for.
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
    state.O_T_EE_d = state.O_T_EE_c = state.O_T_EE;
  }
  ~Arm() {
    for (const int fd : {listening_, tcp_, udp}) {
      if (fd >= 0) ::close(fd);
    }
  }
  Arm(const Arm&) = delete;

  // Answers the one client and sends it states at 1 kHz until `enough`. Throws when the client leaves.
  void serve(const std::atomic<bool>& enough) {
    while (!enough) {
      if (tcp_ < 0) {
        tcp_ = ::accept4(listening_, nullptr, nullptr, SOCK_NONBLOCK);
      } else if (answer_one()) {
        continue;
      }
      if (client.sin_port != 0) send_state();
      sleep_until(now_ns() + kPeriod);
    }
  }
  bool moves() const { return moves_; }

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
  // Whether there was a request.
  bool answer_one() {
    std::array<std::byte, 512> bytes;
    if (::recv(tcp_, bytes.data(), fci::kHeaderSize, MSG_PEEK) != fci::kHeaderSize) return false;
    fci::Header header;
    fci::read(kVersion, bytes, header);
    if (header.size > bytes.size() || ::recv(tcp_, bytes.data(), header.size, MSG_PEEK) != header.size) return false;
    ::recv(tcp_, bytes.data(), header.size, 0);
    const auto body = std::span<const std::byte>(bytes).subspan(fci::kHeaderSize);
    switch (fci::command_of(kVersion, header.command).value()) {
      case fci::Command::kConnect: {
        fci::Connect connect;
        fci::read(kVersion, body, connect);
        socklen_t size = sizeof(client);
        ::getpeername(tcp_, reinterpret_cast<sockaddr*>(&client), &size);
        client.sin_port = htons(connect.udp_port);
        respond(header, {std::byte{0}, std::byte{kVersion}, std::byte{0}});
        break;
      }
      case fci::Command::kGetRobotModel: {
        const std::string urdf = models::urdf(models::arm("fr3"), kVersion);
        std::vector<std::byte> out{std::byte{0}};
        for (const char each : urdf) out.push_back(static_cast<std::byte>(each));
        respond(header, out);
        break;
      }
      case fci::Command::kMove: {
        fci::Move move;
        fci::read(kVersion, body, move);
        respond(header, {std::byte{1}});  // kMotionStarted
        state.robot_mode = fci::RobotMode::kMove;
        state.controller_mode = move.controller_mode;
        state.motion_generator_mode = move.motion_generator_mode;
        moves_ = true;
        break;
      }
      default: respond(header, {std::byte{0}});  // kSuccess
    }
    return true;
  }
  void respond(fci::Header header, const std::vector<std::byte>& body) {
    std::vector<std::byte> bytes(fci::kHeaderSize);
    bytes.insert(bytes.end(), body.begin(), body.end());
    header.size = static_cast<std::uint32_t>(bytes.size());
    fci::write(kVersion, header, bytes);
    ::send(tcp_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }

  int listening_ = -1, tcp_ = -1;
  std::atomic<bool> moves_ = false;
};

// franky-control on the processor given, until it is destroyed.
class Peer {
 public:
  Peer(const std::string& address, int processor) {
    const std::string python = installed();
    pid_ = testing_tools::fork_child();
    if (pid_ == 0) {
      server::RealtimeReport report;
      server::prepare_thread(0, processor, true, report);
      ::dup2(STDERR_FILENO, STDOUT_FILENO);
      ::execl(python.c_str(), python.c_str(), "-c", kPeer, address.c_str(), nullptr);
      std::perror(python.c_str());
      ::_exit(127);
    }
  }
  ~Peer() {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  Peer(const Peer&) = delete;

 private:
  // Its Python: what peer.py prints last.
  static std::string installed() {
    std::FILE* said = ::popen(REPOSITORY_DIR "/.venv/bin/python " REPOSITORY_DIR "/tests/interop/peer.py franky-control 2.0.0", "r");
    std::string line;
    for (std::array<char, 4096> more; said != nullptr && std::fgets(more.data(), more.size(), said) != nullptr;) line = more.data();
    if (said == nullptr || ::pclose(said) != 0 || line.empty()) throw std::runtime_error("franky-control 2.0.0 could not be installed");
    line.pop_back();
    return line;
  }

  ::pid_t pid_ = -1;
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
  skill->mode = skill->controller->mode(Channels::kPose);
  return skill;
}

constexpr double kNoAnswer = -1;

// Time until the answer of kCommandSize bytes to the datagram with that id, us.
template <class Send>
double turnaround(int fd, std::uint64_t id, Send send) {
  std::array<std::byte, 2048> bytes;
  const std::int64_t start = now_ns();
  send();
  for (;;) {
    const ssize_t size = ::recv(fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
    const std::int64_t now = now_ns();
    std::uint64_t answered = 0;
    std::memcpy(&answered, bytes.data(), sizeof(answered));
    if (size == static_cast<ssize_t>(kCommandSize) && answered == id) return static_cast<double>(now - start) * 1e-3;
    if (now - start > kPatience) return kNoAnswer;
  }
}

// A bare UDP echo: answers as many bytes as a command has. A thread of its own, until it is destroyed.
class Echo {
 public:
  Echo(const std::string& address, int processor)
      : own_(bound(SOCK_DGRAM, address, 0)), echo_(bound(SOCK_DGRAM, address, 0)), thread_([this, processor] {
          server::RealtimeReport report;
          server::prepare_thread(0, processor, true, report);
          std::array<std::byte, 2048> bytes;
          for (;;) {
            sockaddr_in from{};
            socklen_t size = sizeof(from);
            const ssize_t got = ::recvfrom(echo_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
            if (got != static_cast<ssize_t>(kStateSize)) return;
            ::sendto(echo_, bytes.data(), kCommandSize, 0, reinterpret_cast<sockaddr*>(&from), size);
          }
        }) {
    socklen_t size = sizeof(at_);
    ::getsockname(echo_, reinterpret_cast<sockaddr*>(&at_), &size);
  }
  ~Echo() {
    send(1);
    thread_.join();
    ::close(own_);
    ::close(echo_);
  }
  Echo(const Echo&) = delete;

  double once() {
    ++id_;
    return turnaround(own_, id_, [this] { send(kStateSize); });
  }

 private:
  void send(std::size_t size) {
    std::array<std::byte, kStateSize> bytes{};
    std::memcpy(bytes.data(), &id_, sizeof(id_));
    ::sendto(own_, bytes.data(), size, 0, reinterpret_cast<sockaddr*>(&at_), sizeof(at_));
  }

  int own_, echo_;
  sockaddr_in at_{};
  std::uint64_t id_ = 0;
  std::thread thread_;
};

// The server's loop at an arm, in a thread of its own; what it computes.
class Looping {
 public:
  Looping(Arm& arm, int processor)
      : driver_(robot::FciDriver::connect(arm.address)),
        limits_(models::limits(models::arm("fr3"), kVersion)),
        model_(models::urdf(models::arm("fr3"), kVersion)),
        loop_(*driver_, model_, limits_, {}, door_) {
    door_.next.put(endless_skill(limits_, arm.state));
    thread_ = std::thread([this, processor] {
      server::RealtimeReport report;
      server::prepare_thread(0, processor, true, report);
      loop_.run();
    });
  }
  ~Looping() {
    door_.quit = true;
    thread_.join();  // the arm is silent now: connection lost
    while (Skill* const* skill = door_.retired.front()) {
      delete *skill;
      door_.retired.pop();
    }
  }
  Looping(const Looping&) = delete;

  // us, of the cycles since the last call.
  std::vector<double> compute() {
    std::vector<double> out;
    for (Record record; records_.next(record);) {
      if (record.compute_ns > 0) out.push_back(static_cast<double>(record.compute_ns) * 1e-3);
    }
    return out;
  }

 private:
  std::unique_ptr<robot::FciDriver> driver_;
  const models::Limits& limits_;
  Model model_;
  Door door_;
  bridge::RingReader<Record> records_{door_.records};
  Loop loop_;
  std::thread thread_;
};

// Serves an arm in a thread until the destructor.
class Serving {
 public:
  explicit Serving(Arm& arm) : thread_([this, &arm] { arm.serve(enough_); }) {}
  ~Serving() {
    enough_ = true;
    thread_.join();
  }
  Serving(const Serving&) = delete;

 private:
  std::atomic<bool> enough_ = false;
  std::thread thread_;
};

int run() {
  const int processors = static_cast<int>(std::thread::hardware_concurrency());
  const int ours = 0, theirs = processors > 1 ? 1 : 0;

  Arm arm, peers_arm;
  std::optional<Looping> loop;
  std::optional<Peer> peer;
  {
    const Serving serving(arm), serving_peer(peers_arm);
    peer.emplace(peers_arm.address, theirs);
    loop.emplace(arm, theirs);
    for (const std::int64_t until = now_ns() + kPeerStart * 1'000'000'000ll; !arm.moves() || !peers_arm.moves();) {
      if (now_ns() > until) throw std::runtime_error(peers_arm.moves() ? "the loop does not begin" : "franky-control does not begin");
      sleep_until(now_ns() + 10 * kPeriod);
    }
    sleep_until(now_ns() + 100 * kPeriod);  // until both have seen that the modes match
  }
  Echo echo(arm.address, theirs);
  pin(ours);

  const auto once = [](Arm& each) { return turnaround(each.udp, each.state.message_id, [&] { each.send_state(); }); };
  enum Who { kLoop, kPeerTurn, kEcho, kWhos };
  std::vector<double> times[kWhos], compute;
  for (int block = 0; block < kWhos * kBlocks; ++block) {
    std::int64_t next = now_ns() + kPeriod;
    const auto who = static_cast<Who>(block % kWhos);
    for (int i = 0; i < kBlock; ++i, next += kPeriod) {
      sleep_until(next);
      const double time = who == kLoop ? once(arm) : who == kPeerTurn ? once(peers_arm) : echo.once();
      if (time == kNoAnswer) throw std::runtime_error("an answer did not come");
      const std::vector<double> computed = loop->compute();
      if (i < kWarmUp) continue;
      times[who].push_back(time);
      compute.insert(compute.end(), computed.begin(), computed.end());
    }
  }

  for (const auto& [name, values] :
       {std::pair{"loop", &times[kLoop]}, {"franky", &times[kPeerTurn]}, {"echo", &times[kEcho]}, {"compute", &compute}}) {
    std::fprintf(stderr, "%-8s %6zu cycles: p50 %7.1f us, p99 %7.1f us, worst %8.1f us\n", name, values->size(),
                 percentile(*values, 0.5), percentile(*values, 0.99), percentile(*values, 1));
  }
  const double median = percentile(times[kLoop], 0.5);
  std::printf("{\"turnaround_minus_echo_us_p50\": %.2f, \"turnaround_ratio_franky_p50\": %.3f}\n",
              median - percentile(times[kEcho], 0.5), median / percentile(times[kPeerTurn], 0.5));
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
