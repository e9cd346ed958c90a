#pragma once

#include "realtime/model.hpp"
#include "wire/fci/robot_state.hpp"

namespace realtime {

// A pose as the robot sends it, column-major.
Eigen::Isometry3d pose(const fci::Pose& values) noexcept;
// Whether it is one: rotation and last row within 1e-3.
bool is_pose(const fci::Pose& values) noexcept;

// The model carries what the robot says that it carries: hand and load together, and has its end-effector frame.
void carry(const fci::RobotState& state, Model& model) noexcept;

}  // namespace realtime
