#pragma once

#include <optional>
#include <vector>

#include "models/arm.hpp"
#include "realtime/trajectories/paced.hpp"

namespace server {

// A way of joints, evenly sampled in the time of its path.
struct SampledWay {
  double duration;                   // s
  std::vector<realtime::Vector7> q;  // rad, from its start to its end; at least three
  std::vector<double> rate;          // the greatest at which the path may be passed there; 1: as it is
};

// The pace at which joints go along it within these rates and with what `share` of the limits of their acceleration and jerk allows;
// to slow down and go faster they use what is left of their acceleration. None where the path needs none, or is over within a cycle.
// (Time parametrization by a forward and a backward pass over the square of the rate, as in Pham and Pham, "A new approach to
// time-optimal path parameterization based on reachability analysis", 2018; afterwards smoothed, as jerk is limited too.)
std::optional<realtime::Pace> pace_along(const SampledWay& way, const models::Limits& limits, double share);

}  // namespace server
