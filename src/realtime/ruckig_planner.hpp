#pragma once

#include <cstddef>
#include <ruckig/ruckig.hpp>

namespace realtime {

// A time-optimal, jerk-limited motion of N coordinates: what it starts from, its limits and its goal in `in`.
template <std::size_t N>
struct RuckigPlanner {
  ruckig::Ruckig<N> ruckig;
  ruckig::InputParameter<N> in;
  ruckig::Trajectory<N> trajectory;

  // False where there is no such motion.
  bool plan() noexcept { return ruckig.calculate(in, trajectory) == ruckig::Result::Working; }
};

}  // namespace realtime
