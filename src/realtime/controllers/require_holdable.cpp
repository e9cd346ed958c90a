#include "realtime/controllers/require_holdable.hpp"

#include "models/arm.hpp"
#include "realtime/check.hpp"
#include "realtime/cholesky.hpp"
#include "realtime/tick.hpp"

namespace realtime {

void require_holdable(const Vector7& stiffness, const Vector7& damping, const Matrix7& inertia, const SpringFields& fields) {
  const Matrix7 mobility = Cholesky<models::kJoints>(inertia).inverse();
  for (int i = 0; i < models::kJoints; ++i) {
    const double m = 1 / mobility(i, i);
    require_within(fields.damping, i, damping[i], 0, 0.999 * m / kTick, "N m s/rad, what a loop of 1 ms can hold here");
    const double b = damping[i] * kTick / m;
    require_within(fields.stiffness, i, stiffness[i], 0, m * b * (1 - b) / (kTick * kTick),
                   "N m/rad, what a loop of 1 ms can hold here with that damping");
  }
}

}  // namespace realtime
