#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "realtime/controllers/controller.hpp"
#include "realtime/terminations/termination.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// One motion request, built in the server room and handed through the door.
struct Skill {
  std::uint64_t id = 0;
  std::unique_ptr<TrajectoryGenerator> trajectory;
  std::unique_ptr<Controller> controller;
  std::vector<std::unique_ptr<Termination>> terminations;  // any of them ends the skill; none: the
                                                           // trajectory's end does
  robot::Mode mode;          // of the controller for this trajectory
  robot::Settings settings;  // of the controller
};

enum class Ending {
  kTerminated,      // a termination said so, or the trajectory is over and there was none
  kStopped,         // stop was asked for; the reference was braked to rest
  kPreempted,       // another skill took over
  kRobotError,      // a reflex or another error of the robot
  kRefused,         // the robot refused the settings or the start of the motion
  kConnectionLost,  // no states, or the TCP connection closed
  kComponentFault,  // trajectory or controller gave what is not finite; the arm was brought to rest without it
};

// How a skill ended.
struct SkillResult {
  std::uint64_t skill_id = 0;
  Ending ending = Ending::kTerminated;
  int termination = -1;          // index of the one that ended it, or -1
  double time = 0;               // s of skill time
  double stretch = 1;            // of the trajectory
  std::uint64_t limited_cycles = 0;  // in which the limiter held the reference or torque back
  std::int64_t first_command_ns = 0;  // CLOCK_MONOTONIC when its first command was sent; 0: never
  std::int64_t last_cycle_ns = 0;     // CLOCK_MONOTONIC at the end of its last cycle
  fci::Errors errors{};          // with kRobotError; none when the robot gave no reason but its mode
  fci::RobotMode robot_mode = fci::RobotMode::kIdle;  // at the end
  fci::Command refused = fci::Command::kMove;  // with kRefused: which request, and
  fci::Status status = fci::Status::kSuccess;  // the robot's answer; kFailed: it gave none within a second
};

}  // namespace realtime
