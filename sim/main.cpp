// fci-sim: simulated Franka arms which speak the robot's own wire protocol.

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <thread>

#include "sim/cell.hpp"
#include "sim/door/control/control_server.hpp"
#include "sim/priority.hpp"

namespace {

constexpr int kMaxArms = 32;

volatile std::sig_atomic_t stopped = 0;

struct Options {
  std::vector<std::string> robots = {"fr3"};
  int arms = 0;
  std::string listen = "127.0.0.1";
  std::string protocol = "auto";
  std::string scene;
  std::string truth, wire;
  std::string pause = "never";
  double speed = 1;
  double patience = 0.25;
  std::uint64_t seed = 1;
  bool lockstep = false;
  bool ideal = false;
  bool control = false;
};

// The address of the n-th arm.
in_addr address_of(in_addr first, std::size_t n) {
  return {htonl(ntohl(first.s_addr) + static_cast<std::uint32_t>(n))};
}

// run.npy, run.2.npy, run.3.npy
std::string file_of(const std::string& first, std::size_t n) {
  if (first.empty() || n == 0) return first;
  const std::filesystem::path path(first);
  std::filesystem::path name = path.stem();
  name += "." + std::to_string(n + 1);
  name += path.extension();
  return path.parent_path() / name;
}

// Arms that share a scene are one cell; otherwise each has a copy of the scene, and a cell of its own.
std::vector<sim::Cell::Options> cells(const Options& options) {
  if (std::isnan(options.speed)) throw std::runtime_error("--speed is nan: expected 0.01 to 20");
  if (std::isnan(options.patience)) throw std::runtime_error("--patience is nan: expected 0.01 to 10 s");
  const std::size_t places = sim::arms_in_scene(options.scene), named = options.robots.size();
  std::size_t count = std::max<std::size_t>(options.arms, named);
  if (count > std::size_t{kMaxArms} || (options.arms != 0 && named > count)) {
    throw std::runtime_error("--robot names " + std::to_string(named) + " robots: expected at most " +
                             std::to_string(options.arms != 0 ? options.arms : kMaxArms));
  }
  if (places > 1) {
    if (options.arms == 0) count = std::max(count, places);
    if (count != places) {
      throw std::runtime_error("scene " + options.scene + " has places for " + std::to_string(places) + " arms, and " +
                               std::to_string(count) + " are asked for");
    }
  }
  sim::Cell::Options common;
  common.scene = options.scene;
  if (options.protocol != "auto") common.version = static_cast<fci::Version>(std::stoi(options.protocol));
  common.lockstep = options.lockstep;
  common.ideal = options.ideal;
  common.speed = options.speed;
  common.patience = std::llround(1e9 * options.patience);
  common.time = options.pause == "never" ? sim::Cell::Time::kRuns : sim::Cell::Time::kBetweenMotionsPaused;
  const in_addr first = sim::parse_address(options.listen);
  std::vector<sim::Cell::Options> cells;
  for (std::size_t i = 0; i < count; ++i) {
    if (i % places == 0) {
      cells.push_back(common);
      cells.back().seed = options.seed + i;
    }
    cells.back().arms.push_back({.model = &models::arm(options.robots[i % options.robots.size()]),
                                 .address = address_of(first, i),
                                 .truth = file_of(options.truth, i),
                                 .wire = file_of(options.wire, i)});
  }
  return cells;
}

int run(const Options& options) {
  sim::WallClock clock;
  std::vector<std::unique_ptr<sim::Cell>> running;
  std::vector<std::unique_ptr<sim::ControlServer>> channels;
  std::vector<sim::Cell::Options> all = cells(options);
  for (const auto& cell : all) running.push_back(std::make_unique<sim::Cell>(cell, clock));
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (std::size_t arm = 0; arm < all[i].arms.size(); ++arm) {
      const in_addr address = all[i].arms[arm].address;
      const bool loopback = ntohl(address.s_addr) >> 24 == 127;
      if (!loopback && !options.control) continue;
      channels.push_back(std::make_unique<sim::ControlServer>(*running[i], arm, sim::text(address)));
    }
  }
  for (const auto& cell : all) {
    for (const auto& arm : cell.arms) {
      std::printf("fci-sim: %s on %s:%d, gripper on port %d, protocol %s, %s\n", std::string(arm.model->title).c_str(),
                  sim::text(arm.address).c_str(), fci::kRobotPort, fci::gripper::kPort, options.protocol.c_str(),
                  options.lockstep ? "lockstep" : "real time");
    }
  }
  // Lockstep waits for its clients, whatever priority they have; an arm in a hurry may never sleep, and must not keep
  // everybody else from running.
  const bool prior = !options.lockstep && options.speed <= 1;
  if (prior) std::printf("fci-sim: %s\n", sim::take_priority().c_str());
  std::puts("fci-sim: ready");
  std::fflush(stdout);

  std::vector<std::exception_ptr> failures(running.size());
  std::vector<std::thread> threads;
  const auto run_cell = [&](std::size_t i) {
    if (prior) sim::take_priority();
    try {
      running[i]->run(stopped);
    } catch (...) {
      failures[i] = std::current_exception();
      stopped = 1;
    }
    running[i]->close();
  };
  for (std::size_t i = 1; i < running.size(); ++i) threads.emplace_back(run_cell, i);
  run_cell(0);
  for (auto& thread : threads) thread.join();
  channels.clear();
  for (const auto& failure : failures) {
    if (failure) std::rethrow_exception(failure);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app("Simulated Franka arms which speak the robot's own wire protocol.", "fci-sim");
  std::vector<std::string> arms, protocols = {"auto"};
  for (const auto& arm : models::arms()) arms.emplace_back(arm.name);
  for (fci::Version v = fci::kOldestVersion; v <= fci::kNewestVersion; ++v) protocols.push_back(std::to_string(v));
  app.add_option("--robot", options.robots, "model of the arm; of several arms: of each, by turns")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::IsMember(arms))
      ->capture_default_str();
  app.add_option("--arms", options.arms, "number of arms; as many as robots or places of the scene otherwise")
      ->check(CLI::Range(1, kMaxArms));
  app.add_option("--listen", options.listen,
                 "IPv4 address of the first arm, the next have those that follow; the ports are the robot's: 1337, and "
                 "1338 for the hand")
      ->capture_default_str();
  app.add_option("--protocol", options.protocol, "version to speak; auto: those that systems of the arm spoke: 5 of FER, 6 to 10 of FR3")
      ->check(CLI::IsMember(protocols))
      ->capture_default_str();
  app.add_flag("--lockstep", options.lockstep, "wait for each command of a motion instead of keeping real time");
  app.add_option("--speed", options.speed, "of the robot's time over the wall's; lockstep takes no notice")
      ->check(CLI::Range(0.01, 20.0))
      ->capture_default_str();
  app.add_option("--patience", options.patience,
                 "s for which lockstep waits for a command, which then is lost; of libfranka's clients less than one")
      ->check(CLI::Range(0.01, 10.0))
      ->capture_default_str();
  app.add_option("--scene", options.scene, "what stands around the arm: a name of sim/scenes, or an MJCF file");
  app.add_option("--truth", options.truth,
                 "NumPy file to write what really happened to, every cycle; FILE.npy, FILE.2.npy ... of several arms");
  app.add_option("--wire", options.wire,
                 "pcap file (Wireshark, tcpdump) to write all states and commands to; FILE.pcap, FILE.2.pcap ... of several arms");
  app.add_option("--pause", options.pause, "let the world stand still from the start, except while an arm does something")
      ->check(CLI::IsMember({"never", "between-motions"}))
      ->capture_default_str();
  app.add_option("--seed", options.seed, "of the sensors' noise")->capture_default_str();
  app.add_flag("--ideal", options.ideal, "joints stiff and without friction, sensors without noise");
  app.add_flag("--control", options.control,
               "control channel (port " + std::to_string(sim::ControlServer::kPort) +
                   ") also where other computers reach it; on 127.0.0.0/8 it is always there");
  CLI11_PARSE(app, argc, argv);

  spdlog::set_default_logger(std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::stderr_sink_mt>()));
  spdlog::set_pattern("fci-sim: %v");
  struct sigaction action {};
  action.sa_handler = [](int) { stopped = 1; };
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
  ::signal(SIGPIPE, SIG_IGN);

  try {
    return run(options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "fci-sim: %s\n", error.what());
    return 1;
  }
}
