#pragma once

namespace realtime {

inline constexpr double kTick = 0.001;  // s, a cycle of the robot

}  // namespace realtime
