// What a cycle costs the simulated arm: a command that has come, checks, control, physics, estimates, the state sent.
// FR3 with its hand, a table and three blocks; the closed fingers press on the table.
//   sim_step_us_p50   µs, median of 20 s

#include <algorithm>
#include <cstdio>
#include <thread>
#include <vector>

#include "bench/fci_client.hpp"
#include "sim/clock.hpp"
#include "sim/door/robot_server.hpp"
#include "sim/robot/gripper.hpp"
#include "sim/world/world.hpp"

namespace {

constexpr int kWay = 4000;      // cycles down to the table
constexpr int kCycles = 20000;  // measured
constexpr double kDown = -0.50, kAhead = 0.15;  // m: some centimetres into the table

// Commands the arm down on its table and stays there; until the arm has gone.
void command(const std::string& address) try {
  bench::FciClient client(address);
  fci::SetCollisionBehavior behavior;
  for (auto* torques : {&behavior.lower_torque_thresholds_acceleration, &behavior.upper_torque_thresholds_acceleration,
                        &behavior.lower_torque_thresholds_nominal, &behavior.upper_torque_thresholds_nominal}) {
    torques->fill(1000);
  }
  for (auto* forces : {&behavior.lower_force_thresholds_acceleration, &behavior.upper_force_thresholds_acceleration,
                       &behavior.lower_force_thresholds_nominal, &behavior.upper_force_thresholds_nominal}) {
    forces->fill(1000);
  }
  client.ask(behavior);
  client.ask(fci::Move{.controller_mode = fci::ControllerMode::kCartesianImpedance,
                       .motion_generator_mode = fci::MotionGeneratorMode::kCartesianPosition,
                       .maximum_path_deviation = {10, 3.12, 6.28},
                       .maximum_goal_pose_deviation = {10, 3.12, 6.28}});
  while (client.receive().robot_mode != fci::RobotMode::kMove) {
  }
  fci::RobotCommand down;
  const auto start = client.receive().O_T_EE_c;
  for (int i = 1;; ++i) {
    const double s = std::min(1.0, static_cast<double>(i) / kWay);
    down.O_T_EE_c = start;
    const double way = s * s * s * (10 - 15 * s + 6 * s * s);
    down.O_T_EE_c[12] += kAhead * way;
    down.O_T_EE_c[14] += kDown * way;
    client.send(down);
    client.receive();
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "client: %s\n", error.what());  // at the end: the arm has gone
}

}  // namespace

int main() {
  const models::Arm& arm = models::arm("fr3");
  const std::string address = bench::some_address();
  sim::WallClock clock;
  sim::Poller poller(clock);
  sim::World world({.arm = &arm, .more_arms = {}, .scene = REPOSITORY_DIR "/sim/scenes/table_with_blocks.xml"});
  sim::Robot robot(arm);
  sim::Gripper gripper(world.truth().finger);
  auto server = std::make_unique<sim::RobotServer>(arm, sim::parse_address(address), std::nullopt, "", robot, poller);
  robot.sense(world.truth());
  gripper.move({.width = 0, .speed = 0.1});
  std::thread client(command, address);

  std::vector<double> taken;
  int commanded = 0, contacts = 0;
  while (static_cast<int>(taken.size()) < kCycles) {
    std::int64_t begin;
    const fci::RobotCommand* received = nullptr;
    do {
      begin = clock.now();
      if (poller.ready() || server->due()) server->serve();
      received = server->receive();
    } while (robot.awaits_command() && received == nullptr);
    world.step(robot.control(received), gripper.control(world.truth().finger));
    robot.sense(world.truth());
    server->publish(0);
    const double us = 1e-3 * static_cast<double>(clock.now() - begin);
    if (!robot.awaits_command()) {
      if (fci::any(robot.state().errors)) break;
      ::usleep(1000);  // the client gets ready
      continue;
    }
    if (received != nullptr && ++commanded > kWay + 1000) {
      taken.push_back(us);
      contacts += world.truth().contact_wrench[2] > 1;
    }
  }
  server.reset();
  client.join();
  if (static_cast<int>(taken.size()) < kCycles || contacts < kCycles) {
    std::fprintf(stderr, "%zu of %d cycles measured, %d of them in contact: %s\n", taken.size(), kCycles, contacts,
                 fci::names(robot.state().errors).c_str());
    return 1;
  }
  std::fprintf(stderr, "pressed with %.1f N\n", world.truth().contact_wrench[2]);
  std::nth_element(taken.begin(), taken.begin() + kCycles / 2, taken.end());
  std::printf("{\"sim_step_us_p50\": %.2f}\n", taken[kCycles / 2]);
}
