// fci-sim: a simulated Franka arm which speaks the robot's own wire protocol.

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <optional>

#include "sim/clock.hpp"
#include "sim/gripper_server.hpp"
#include "sim/robot_server.hpp"
#include "sim/truth_file.hpp"

namespace {

// A client that falls silent in lockstep holds up one cycle for this long; then the cycle has lost its command. Twenty
// of them end the motion, and a client which waits for a state for a second must not give up meanwhile.
constexpr std::int64_t kSilence = 250'000'000;  // ns

// When the simulator itself was late, clients on the same computer were held up as well: they still have this long.
constexpr std::int64_t kGrace = 1'000'000;  // ns

volatile std::sig_atomic_t stopped = 0;

struct Options {
  std::string robot = "fr3";
  std::string listen = "127.0.0.1";
  std::string protocol = "auto";
  std::string scene;
  std::string truth;
  bool lockstep = false;
  bool ideal = false;
};

class Simulation {
 public:
  explicit Simulation(const Options& options)
      : lockstep_(options.lockstep),
        world_({.arm = &models::arm(options.robot), .scene = options.scene, .ideal = options.ideal}),
        robot_(models::arm(options.robot)),
        robot_server_(models::arm(options.robot), sim::parse_address(options.listen), version(options.protocol),
                      robot_, poller_),
        gripper_server_(sim::parse_address(options.listen), gripper_, poller_) {
    if (!options.truth.empty()) truth_.emplace(options.truth, world_);
    robot_.sense(world_.truth());
  }

  void run() {
    while (!stopped) cycle();
    if (clock_.late() > 0) {
      spdlog::info("{} cycles of {} were late by this computer's fault, the worst by {:.1f} ms", clock_.late(),
                   robot_.state().message_id, 1e3 * clock_.worst_delay());
    }
  }

 private:
  static std::optional<fci::Version> version(const std::string& protocol) {
    if (protocol == "auto") return std::nullopt;
    return static_cast<fci::Version>(std::stoi(protocol));
  }

  void cycle() {
    const fci::RobotCommand* command = next_command();
    const sim::Vector7 tau = robot_.control(command);
    world_.step(tau, gripper_.control(world_.truth().finger));
    robot_.sense(world_.truth());
    robot_server_.publish();
    gripper_server_.publish();
    if (truth_) truth_->append(world_, robot_.state().message_id, robot_.moving());
    clock_.done();
  }

  const fci::RobotCommand* next_command() {
    if (lockstep_ && robot_.awaits_command()) {
      serve();
      const auto* command = wait_for_command(kSilence);
      if (robot_.awaits_command()) {
        clock_.restart();
        return command;
      }
      // The motion was stopped, or its client has gone: from here on time is the wall's again.
    }
    const bool late = clock_.wait();
    serve();
    const auto* command = robot_server_.receive();
    if (command == nullptr && late && robot_.awaits_command()) command = wait_for_command(kGrace);
    return command;
  }

  // Waits as long as the motion goes on.
  const fci::RobotCommand* wait_for_command(std::int64_t patience) {
    const std::int64_t until = sim::Clock::now() + patience;
    while (robot_.awaits_command() && !stopped) {
      if (const auto* command = robot_server_.wait()) return command;
      if (sim::Clock::now() > until) break;
      serve();
    }
    return nullptr;
  }

  void serve() {
    const bool ready = poller_.ready();
    if (ready || robot_server_.due()) robot_server_.serve();
    if (ready || gripper_server_.due()) gripper_server_.serve();
  }

  bool lockstep_;
  sim::Poller poller_;
  sim::World world_;
  sim::Robot robot_;
  sim::Gripper gripper_;
  sim::RobotServer robot_server_;
  sim::GripperServer gripper_server_;
  std::optional<sim::TruthFile> truth_;
  sim::Clock clock_;
};

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app("A simulated Franka arm which speaks the robot's own wire protocol.", "fci-sim");
  std::vector<std::string> arms, protocols = {"auto"};
  for (const auto& arm : models::arms()) arms.emplace_back(arm.name);
  for (fci::Version v = fci::kOldestVersion; v <= fci::kNewestVersion; ++v) protocols.push_back(std::to_string(v));
  app.add_option("--robot", options.robot, "model of the arm")->check(CLI::IsMember(arms))->capture_default_str();
  app.add_option("--listen", options.listen, "IPv4 address; the ports are the robot's: 1337, and 1338 for the hand")
      ->capture_default_str();
  app.add_option("--protocol", options.protocol, "version to speak; auto: each client's own")
      ->check(CLI::IsMember(protocols))
      ->capture_default_str();
  app.add_flag("--lockstep", options.lockstep, "wait for each command of a motion instead of keeping real time");
  app.add_option("--scene", options.scene, "MJCF file of what stands around the arm");
  app.add_option("--truth", options.truth, "NumPy file to write what really happened to, every cycle");
  app.add_flag("--ideal", options.ideal, "joints without friction, sensors without noise");
  CLI11_PARSE(app, argc, argv);

  spdlog::set_default_logger(std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::stderr_sink_st>()));
  spdlog::set_pattern("fci-sim: %v");
  struct sigaction action {};
  action.sa_handler = [](int) { stopped = 1; };
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
  ::signal(SIGPIPE, SIG_IGN);

  try {
    Simulation simulation(options);
    const std::string& title = std::string(models::arm(options.robot).title);
    std::printf("fci-sim: %s on %s:%d, gripper on port %d, protocol %s, %s\n", title.c_str(), options.listen.c_str(),
                fci::kRobotPort, fci::gripper::kPort, options.protocol.c_str(),
                options.lockstep ? "lockstep" : "real time");
    std::fflush(stdout);
    simulation.run();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "fci-sim: %s\n", error.what());
    return 1;
  }
}
