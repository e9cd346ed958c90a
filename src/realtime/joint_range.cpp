#include "realtime/joint_range.hpp"

#include <algorithm>

namespace realtime {
namespace {

// rad/s that the envelope should still allow, or the last of the way takes for ever.
constexpr double kSlowest = 0.05;

// Between the end of the envelope and where it still allows that.
double closed(const models::Limits& limits, int i) {
  const double speed = limits.envelope_offset[i] + kSlowest;
  return speed * speed / (2 * limits.envelope_deceleration[i]);
}

}  // namespace

double rest_min(const models::Limits& limits, int i) {
  if (limits.envelope_deceleration[i] == 0) return limits.q_min[i];
  return std::max(limits.q_min[i], limits.envelope_min[i] + closed(limits, i));
}

double rest_max(const models::Limits& limits, int i) {
  if (limits.envelope_deceleration[i] == 0) return limits.q_max[i];
  return std::min(limits.q_max[i], limits.envelope_max[i] - closed(limits, i));
}

}  // namespace realtime
