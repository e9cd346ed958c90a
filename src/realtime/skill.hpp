#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "realtime/controllers/controller.hpp"
#include "realtime/held_by.hpp"
#include "realtime/part_watch.hpp"
#include "realtime/slow.hpp"
#include "realtime/terminations/termination.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// Numbers of the kinds of a skill's parts, by which the server room names one that is at fault; 0: it has none.
struct KindNumbers {
  std::uint16_t trajectory = 0, controller = 0;
  std::vector<std::uint16_t> terminations;
};

// One motion request, built in the server room and handed through the door.
struct Skill {
  std::uint64_t id = 0;
  std::unique_ptr<TrajectoryGenerator> trajectory;
  std::unique_ptr<Controller> controller;
  std::vector<std::unique_ptr<Termination>> terminations;  // any of them ends the skill; none: the
                                                           // trajectory's end does
  std::vector<std::shared_ptr<SensorInput>> inputs;  // of the parts that it has had last
  KindNumbers numbers;
  robot::Mode mode;          // of the controller for this trajectory
  robot::Settings settings;  // of the controller
  std::uint64_t after = 0;   // id of the skill that it waits for, to begin when that has ended by itself (0: none), or
  double blend = 0;          // s before its trajectory is over, within a robot controller
  double speed = 1;          // of the time along its trajectory, 0.01 to 1
  std::int64_t start_ns = 0;  // CLOCK_MONOTONIC; until then the arm rests where it is, or the skill before goes on

  // What its trajectory starts from, on that one's clock; `speed_before`: of the skill that led there. After a faster one it begins
  // at rest: that motion is braked by the limits, and not on the slower clock, which would lead it astray.
  Reference start_from(Reference reference, double speed_before) const noexcept {
    slow(reference, speed_before <= speed ? 1 / speed : 0, 0);
    return reference;
  }
};

// Other parts for a skill that runs, of the same robot controller and settings. Goes back through the door with the parts that
// it replaced.
struct Change {
  std::uint64_t skill_id = 0;
  std::unique_ptr<TrajectoryGenerator> trajectory;  // begins at the reference as it then is; null: no change
  std::unique_ptr<Controller> controller;           // torque goes on where it is; null: no change
  std::vector<std::unique_ptr<Termination>> terminations;
  bool changes_terminations = false;
  std::vector<std::shared_ptr<SensorInput>> inputs;  // of all parts that the skill then has
  KindNumbers numbers;  // of the parts that are given
  bool done = false;  // by the loop; else the skill had ended
};

enum class Ending {
  kTerminated,      // a termination said so, or the trajectory is over and there was none
  kStopped,         // stop was asked for; the reference was braked to rest
  kPreempted,       // another skill took over
  kRobotError,      // a reflex or another error of the robot
  kRefused,         // the robot refused the settings or the start of the motion
  kConnectionLost,  // no states, or the TCP connection closed
  kCancelled,       // queued, and the skill before did not end by itself
  kComponentFault,  // a part did what does not belong into the loop; the arm was brought to rest without it
};

// How far an arm is from where it was to go: of its farthest joint (rad), or of its pose (m, rad); what there is.
struct Left {
  std::optional<double> joints = {}, position = {}, angle = {};
};

// How a skill ended.
struct SkillResult {
  std::uint64_t skill_id = 0;
  Ending ending = Ending::kTerminated;
  int termination = -1;          // index of the one that ended it, or -1
  double time = 0;               // s of skill time
  double path_time = 0;          // s along its trajectory
  std::uint64_t lost_states = 0;    // that did not come
  std::uint64_t lost_commands = 0;  // of the last 100, that the robot did not have in time
  double stretch = 1;            // of the trajectory
  std::uint64_t limited_cycles = 0;  // in which reference or torque were held back
  HeldBy held_by = HeldBy::kNothing;  // in any of them
  std::int64_t first_command_ns = 0;  // CLOCK_MONOTONIC when its first command was sent; 0: never
  std::int64_t last_cycle_ns = 0;     // CLOCK_MONOTONIC at the end of its last cycle
  fci::Errors errors{};          // with kRobotError; none when the robot gave no reason but its mode
  fci::RobotMode robot_mode = fci::RobotMode::kIdle;  // at the end
  fci::Command refused = fci::Command::kMove;  // with kRefused: which request, and
  fci::Status status = fci::Status::kSuccess;  // the robot's answer; kFailed: it gave none within a second
  std::uint32_t wall = 0;        // Wall::id of the last one that held reference or torque back; 0: none
  std::optional<std::uint64_t> record = {};  // number in Door::records of the cycle that ended it, which comes after this;
                                             // none with kConnectionLost
  AfterContact after_contact = AfterContact::kNoContact;
  double backed_off = 0;         // m, with kBackedOff
  Left left{};                   // to the trajectory's goal, for a controller that is to bring the arm there
  PartFault fault{};             // with kComponentFault: what, of which part; with kRobotError: its longest step
};

}  // namespace realtime
