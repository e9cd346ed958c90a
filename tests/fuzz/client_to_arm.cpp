// Anything that a client can send to the simulated arm, on any of its ports: no crash, no value that is no number in
// what the arm reports or drives its joints with, no motion without a Move.

#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "models/arm.hpp"
#include "require.hpp"
#include "script.hpp"
#include "sim/door/gripper_server.hpp"
#include "sim/door/robot_server.hpp"
#include "sim/world/world.hpp"

namespace {

enum Step { kRobotTcp, kRobotUdp, kRobotCommand, kCycles, kNewRobotClient, kGripperTcp, kNewGripperClient, kSteps };
constexpr std::int64_t kPeriod = 1'000'000;  // ns
constexpr int kMostCycles = 64;              // in one step

using fuzz::require;

// The sockets of one client, which never waits.
struct Client {
  Client(const std::string& address, std::uint16_t port) {
    sockaddr_in arm{};
    arm.sin_family = AF_INET;
    arm.sin_addr = sim::parse_address(address);
    arm.sin_port = htons(port);
    tcp = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    udp = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    ::connect(tcp, reinterpret_cast<sockaddr*>(&arm), sizeof arm);
    ::connect(udp, reinterpret_cast<sockaddr*>(&arm), sizeof arm);
    const linger now{1, 0};  // hundreds of connections a second must not wait for their ports
    ::setsockopt(tcp, SOL_SOCKET, SO_LINGER, &now, sizeof now);
  }
  ~Client() {
    ::close(tcp);
    ::close(udp);
  }
  Client(const Client&) = delete;
  void send(int fd, std::span<const std::byte> bytes) {
    ::send(fd, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    std::array<std::byte, 4096> answers;
    while (::recv(tcp, answers.data(), answers.size(), MSG_DONTWAIT) > 0) {
    }
  }
  int tcp, udp;
};

class Arm {
 public:
  Arm() {
    spdlog::set_level(spdlog::level::off);
    std::random_device random;
    for (;;) {
      const auto part = [&] { return std::to_string(random() % 250 + 2); };
      address_ = "127." + part() + "." + part() + "." + part();
      try {
        robot_server_ = std::make_unique<sim::RobotServer>(model_, sim::parse_address(address_), std::nullopt, "", robot_,
                                                           poller_);
        gripper_server_ = std::make_unique<sim::GripperServer>(sim::parse_address(address_), gripper_, poller_);
        break;
      } catch (const std::runtime_error&) {
      }
    }
    robot_.sense(world_.truth(0));
    meet();
  }

  void run(fuzz::Script script) {
    int what = 0;
    std::span<const std::byte> bytes;
    while (script.next(what, bytes)) {
      switch (what % kSteps) {
        case kRobotTcp: robot_client_->send(robot_client_->tcp, bytes); break;
        case kRobotUdp: robot_client_->send(robot_client_->udp, bytes); break;
        case kRobotCommand: {  // for the newest state, which no input can know
          std::vector<std::byte> command(bytes.begin(), bytes.end());
          const std::uint64_t id = robot_.state().message_id;
          if (command.size() >= sizeof id) std::memcpy(command.data(), &id, sizeof id);
          robot_client_->send(robot_client_->udp, command);
          break;
        }
        case kCycles: cycles(static_cast<int>(bytes.size()) % kMostCycles); break;
        case kNewRobotClient: robot_client_.reset(); break;
        case kGripperTcp: gripper_client_->send(gripper_client_->tcp, bytes); break;
        case kNewGripperClient: gripper_client_.reset(); break;
      }
      cycles(1);
      meet();
    }
    // The next input meets an arm that has no client and stands.
    robot_client_.reset();
    gripper_client_.reset();
    for (int i = 0; i < 3000 && (i < 2 || robot_.moving()); ++i) cycles(1);
    require(!robot_.moving(), "a motion whose client has gone goes on for more than three seconds");
    robot_.recover();
    for (int i = 0; i < 500 && robot_.recovering(); ++i) cycles(1);
    meet();
  }

 private:
  void meet() {
    if (!robot_client_) robot_client_ = std::make_unique<Client>(address_, fci::kRobotPort);
    if (!gripper_client_) gripper_client_ = std::make_unique<Client>(address_, fci::gripper::kPort);
  }

  void cycles(int count) {
    for (int i = 0; i < count; ++i) {
      robot_server_->serve();
      gripper_server_->serve();
      const bool moves = robot_.moving();
      const sim::Vector7 tau = robot_.control(robot_server_->receive());
      const auto force = gripper_.control(world_.truth(0).finger);
      world_.step(tau, force);
      robot_.sense(world_.truth(0));
      robot_server_->publish(kPeriod);
      gripper_server_->publish();
      const auto number = [](double value) { return std::isfinite(value); };
      require(std::all_of(tau.begin(), tau.end(), number), "torques that are no numbers");
      require(std::all_of(force.begin(), force.end(), number), "forces of the fingers that are no numbers");
      const fci::RobotState& state = robot_.state();
      for (const auto& values : {state.q_d, state.dq_d, state.ddq_d, state.tau_J_d, state.tau_ext_hat_filtered}) {
        require(std::all_of(values.begin(), values.end(), number), "a state that is no number");
      }
      for (const auto& values : {state.O_F_ext_hat_K, state.K_F_ext_hat_K}) {
        require(std::all_of(values.begin(), values.end(), number), "a wrench that is no number");
      }
      require(std::all_of(state.O_T_EE_c.begin(), state.O_T_EE_c.end(), number), "a pose that is no number");
      if (!moves && state.robot_mode == fci::RobotMode::kIdle) {
        require(std::all_of(state.dq_d.begin(), state.dq_d.end(), [](double v) { return v == 0; }),
                "the reference moves without a motion");
      }
    }
  }

  // One that has spoken every version.
  const models::Arm model_ = [] {
    models::Arm arm = models::arm("fr3");
    arm.oldest_version = fci::kOldestVersion;
    return arm;
  }();
  sim::World world_{{.arm = &model_}};
  sim::WallClock clock_;
  sim::Poller poller_{clock_};
  sim::Robot robot_{model_};
  sim::Gripper gripper_{world_.truth().finger};
  std::string address_;
  std::unique_ptr<sim::RobotServer> robot_server_;
  std::unique_ptr<sim::GripperServer> gripper_server_;
  std::unique_ptr<Client> robot_client_, gripper_client_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Arm arm;
  arm.run({data, size});
  return 0;
}
