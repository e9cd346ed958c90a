#include "realtime/controllers/require_holdable.hpp"

#include <algorithm>
#include <cmath>

#include "models/arm.hpp"
#include "realtime/check.hpp"
#include "realtime/cholesky.hpp"
#include "realtime/tick.hpp"

namespace realtime {
namespace {

constexpr double kMostDamping = 0.999;  // of b, that is taken
constexpr double kShare = 0.95;         // of b and of a, that is left: there an oscillation dies away

}  // namespace

Vector7 inertia_to_hold(const Matrix7& mobility) noexcept {
  const Vector7 free = mobility.diagonal().cwiseSqrt().cwiseInverse();
  return free.cwiseQuotient(mobility.cwiseAbs() * free);
}

void require_holdable(const Vector7& stiffness, const Vector7& damping, const Matrix7& inertia, const SpringFields& fields) {
  const Vector7 m = inertia_to_hold(Cholesky<models::kJoints>(inertia).inverse());
  for (int i = 0; i < models::kJoints; ++i) {
    require_within(fields.damping, i, damping[i], 0, kMostDamping * m[i] / kTick, "N m s/rad, what a loop of 1 ms can hold here");
    const double b = damping[i] * kTick / m[i];
    require_within(fields.stiffness, i, stiffness[i], 0, m[i] * b * (1 - b) / (kTick * kTick),
                   "N m/rad, what a loop of 1 ms can hold here with that damping");
  }
}

void keep_holdable(const Matrix7& mobility, Vector7& stiffness, Vector7& damping) noexcept {
  const Vector7 m = inertia_to_hold(mobility);
  for (int i = 0; i < models::kJoints; ++i) {
    const double a = stiffness[i] * kTick * kTick / (kShare * m[i]);
    // The greatest damping with which that spring can be held; beside one that is too hard, half of what a joint takes.
    const double most = std::min((1 + std::sqrt(std::max(1 - 4 * a, 0.))) / 2, kShare);
    const double b = std::min(damping[i] * kTick / m[i], most);
    damping[i] = b * m[i] / kTick;
    stiffness[i] = std::min(a, b * (1 - b)) * kShare * m[i] / (kTick * kTick);
  }
}

}  // namespace realtime
