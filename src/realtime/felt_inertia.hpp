#pragma once

#include "models/joint_figures.hpp"
#include "realtime/cholesky.hpp"
#include "realtime/model.hpp"

namespace realtime {

// Links and motors, kg m²; `links`: Model::mass().
inline Matrix7 felt_inertia(const Matrix7& links) noexcept {
  Matrix7 M = links;
  M.diagonal() += Vector7::Map(models::kMotorInertia.data());
  return M;
}

// How the joints accelerate with torque: its inverse.
inline Matrix7 joint_mobility(const Matrix7& links) noexcept {
  return Cholesky<models::kJoints>(felt_inertia(links)).inverse();
}

}  // namespace realtime
