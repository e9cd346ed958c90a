#include "realtime/terminations/velocity_below.hpp"

#include "realtime/check.hpp"

namespace realtime {

VelocityBelow::VelocityBelow(const Parameters& parameters) : parameters_(parameters) {
  require_within("threshold", -1, parameters.threshold, 1e-4, 10, "rad/s");
  require_within("duration", -1, parameters.duration, 0, 3600, "s");
  require_within("after", -1, parameters.after, 0, 3600, "s");
}

bool VelocityBelow::step(const Cycle& cycle, const Progress&) noexcept {
  constexpr double kRounding = 1e-9;  // s: times are sums of milliseconds
  const bool slow = cycle.time >= parameters_.after - kRounding && cycle.dq.cwiseAbs().maxCoeff() < parameters_.threshold;
  slow_ = slow ? slow_ + cycle.dt : 0;
  return slow && slow_ >= parameters_.duration - kRounding;
}

}  // namespace realtime
