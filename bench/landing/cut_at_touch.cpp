// What bench/landing.py compares with: an arm that comes down under torque control, and whose torque beyond gravity is cut in the
// first cycle in which it is measured to touch.
//
//   cut_at_touch ADDRESS HEIGHT < WAY
//
// WAY: joints and their velocities of each ms, rad and rad/s, 14 numbers a line; the arm is brought to the first of them. HEIGHT of
// EE at the touch, m in O. The arm speaks version 10, and is silent after half a second without torque.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <vector>

#include "bench/fci_client.hpp"

namespace {

using Row = std::array<double, 14>;
constexpr std::array<double, 7> kStiffness = {600, 600, 600, 600, 250, 150, 50}, kDamping = {60, 60, 60, 60, 30, 25, 15};
constexpr int kApproach = 2000, kSettle = 500, kAfter = 500;  // cycles
constexpr double kMostStep = 0.9;                            // N m in a cycle

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 3) throw std::runtime_error("expected ADDRESS HEIGHT");
  const double height = std::strtod(argv[2], nullptr);
  std::vector<Row> way;
  for (Row row; std::cin >> row[0];) {
    for (std::size_t i = 1; i < row.size(); ++i) std::cin >> row[i];
    way.push_back(row);
  }
  if (way.empty()) throw std::runtime_error("no way comes over the standard input");

  bench::FciClient arm(argv[1]);
  arm.ask(fci::SetCollisionBehavior{[] {
    fci::Vector7 tau;
    fci::Vector6 force;
    tau.fill(120);
    force.fill(120);
    return fci::SetCollisionBehavior{tau, tau, tau, tau, force, force, force, force};
  }()});
  arm.ask(fci::Move{.controller_mode = fci::ControllerMode::kExternal, .motion_generator_mode = fci::MotionGeneratorMode::kNone});
  while (arm.receive().robot_mode != fci::RobotMode::kMove) {
  }
  const fci::Vector7 from = arm.receive().q;
  fci::RobotCommand command;
  int cut = -1;
  for (int cycle = 0; cut < 0 || cycle < cut + kAfter; ++cycle) {
    const fci::RobotState& state = arm.receive();
    if (state.robot_mode != fci::RobotMode::kMove) throw std::runtime_error("the arm has stopped");
    const int on = cycle - kApproach - kSettle;
    if (on >= static_cast<int>(way.size()) && cut < 0) throw std::runtime_error("the way ends above the plate");
    if (cut < 0 && on >= 0 && state.O_T_EE[14] <= height) cut = cycle;
    const double s = std::min(1., static_cast<double>(cycle) / kApproach), share = s * s * s * (10 + s * (-15 + s * 6));
    for (std::size_t i = 0; i < 7; ++i) {
      const Row& row = way[std::min(static_cast<std::size_t>(std::max(on, 0)), way.size() - 1)];
      const double q = on >= 0 ? row[i] : from[i] + share * (way[0][i] - from[i]), dq = on >= 0 ? row[i + 7] : 0;
      const double tau = cut >= 0 ? 0 : kStiffness[i] * (q - state.q[i]) + kDamping[i] * (dq - state.dq[i]);
      command.tau_J_d[i] += std::clamp(tau - command.tau_J_d[i], -kMostStep, kMostStep);
    }
    arm.send(command);
  }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "cut_at_touch: %s\n", error.what());
  return 1;
}
