#pragma once

namespace realtime {

// 1/s: no mode, axis or direction of the joints is damped faster by a law of ours, as torque comes a cycle late.
constexpr double kFastestDamping = 400;

}  // namespace realtime
