#pragma once

namespace sim {

constexpr double kDt = 0.001;  // s, of a cycle of the robot

}  // namespace sim
