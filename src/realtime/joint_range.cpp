#include "realtime/joint_range.hpp"

namespace realtime {
namespace {

// rad/s that the envelope should still allow, or the last of the way takes for ever.
constexpr double kSlowest = 0.05;

double closed(const models::Limits& limits, int i) {
  if (limits.envelope_deceleration[i] == 0) return 0;
  const double speed = limits.envelope_offset[i] + kSlowest;
  return speed * speed / (2 * limits.envelope_deceleration[i]);
}

}  // namespace

double rest_min(const models::Limits& limits, int i) { return limits.q_min[i] + closed(limits, i); }
double rest_max(const models::Limits& limits, int i) { return limits.q_max[i] - closed(limits, i); }

}  // namespace realtime
