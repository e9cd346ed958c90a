#pragma once

#include "realtime/reference.hpp"

namespace realtime {

// What joints take together that exert tau (N m, gravity included) and move at dq (rad/s); those that are driven give nothing back. W.
inline double power_taken(const Vector7& tau, const Vector7& dq) noexcept { return tau.cwiseProduct(dq).cwiseMax(0).sum(); }

}  // namespace realtime
