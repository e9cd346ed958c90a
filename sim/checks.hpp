#pragma once

#include <optional>

#include "models/arm.hpp"
#include "sim/motion_generator.hpp"
#include "wire/fci/robot_command.hpp"

namespace sim {

// What the robot refuses in the commands of a motion. One function for each moment at which it looks.

// Consecutive cycles without a command after which a motion ends.
inline constexpr int kLostCommands = 20;

// A command that is no command: NaN or infinite, or a pose that is no transform. Only what the motion uses
// is looked at.
std::optional<fci::Error> check_values(fci::ControllerMode controller, fci::MotionGeneratorMode generator,
                                       const fci::RobotCommand& command);

// Stopping dead after `desired` leaves the limits of acceleration or jerk: finished while still moving.
std::optional<fci::Error> check_finish(const models::Limits& limits, fci::MotionGeneratorMode generator,
                                       const MotionGenerator::Desired& desired);

// The same for a motion with torques alone, where the arm itself must be about at rest.
std::optional<fci::Error> check_finish(const Eigen::Matrix<double, 7, 1>& dq);

}  // namespace sim
