#include "realtime/terminations/time.hpp"

#include <stdexcept>
#include <utility>

#include "realtime/check.hpp"

namespace realtime {

Time::Time(const Parameters& parameters) : parameters_(parameters) {
  constexpr double kLongest = 1e9;  // s
  if (parameters.seconds.has_value() == parameters.after_trajectory.has_value()) {
    throw std::invalid_argument(parameters.seconds ? "seconds and after_trajectory are both given: give one of them"
                                                   : "neither seconds nor after_trajectory is given: give one of them");
  }
  if (parameters.seconds) require_within("seconds", -1, *parameters.seconds, 0, kLongest, "s");
  if (parameters.after_trajectory) {
    require_within("after_trajectory", -1, *parameters.after_trajectory, 0, kLongest, "s");
  }
}

void Time::start() noexcept { began_ = -1; }

bool Time::step(const Cycle& cycle, const Progress& progress) noexcept {
  constexpr double kRounding = 1e-9;  // s: skill time is a sum of milliseconds
  if (parameters_.seconds) return cycle.time >= *parameters_.seconds - kRounding;
  if (std::exchange(began_, progress.began) != progress.began) over_since_ = -1;
  // An arm that is held does not keep the time from passing.
  const bool should_be = progress.waits && cycle.time >= progress.planned - kRounding;
  if (over_since_ < 0 && (progress.trajectory_over || should_be)) over_since_ = cycle.time;
  return over_since_ >= 0 && cycle.time >= over_since_ + *parameters_.after_trajectory - kRounding;
}

}  // namespace realtime
