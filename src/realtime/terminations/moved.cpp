#include "realtime/terminations/moved.hpp"

#include <stdexcept>

#include "realtime/check.hpp"
#include "realtime/rotation.hpp"

namespace realtime {

Moved::Moved(const Parameters& parameters) : parameters_(parameters) {
  if (!parameters.distance && !parameters.angle) {
    throw std::invalid_argument("neither distance nor angle is given: give at least one of them");
  }
  if (parameters.distance) require_within("distance", -1, *parameters.distance, 1e-6, 2, "m");
  if (parameters.angle) require_within("angle", -1, *parameters.angle, 1e-6, 3.1, "rad");
}

bool Moved::step(const Cycle& cycle, const Progress&) noexcept {
  if (!begun_) from_ = cycle.O_T_EE;
  begun_ = true;
  const Vector3 way = cycle.O_T_EE.translation() - from_.translation();
  const Eigen::Quaterniond turn(from_.linear().transpose() * cycle.O_T_EE.linear());
  return (parameters_.distance && way.norm() >= *parameters_.distance) ||
         (parameters_.angle && log(turn.normalized()).norm() >= *parameters_.angle);
}

}  // namespace realtime
