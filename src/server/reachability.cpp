#include "server/reachability.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <random>

#include "realtime/joint_range.hpp"

namespace server {
namespace {

using realtime::Matrix67;
using realtime::Vector6;
using realtime::Vector7;

constexpr double kDistanceTolerance = 1e-4;  // m
constexpr double kAngleTolerance = 1e-3;     // rad
constexpr int kIterations = 100;
constexpr int kPostures = 24;

// Translation and rotation vector, axes of O, from `from` to `to`.
Vector6 difference(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to) {
  const Eigen::AngleAxisd rotation(to.linear() * from.linear().transpose());
  Vector6 error;
  error << to.translation() - from.translation(), rotation.angle() * rotation.axis();
  return error;
}

// Step of damped least squares; a joint whose step leads out of its limits stays there, and the others
// do without it.
Vector7 damped_step(Matrix67 jacobian, const Vector6& error, const Vector7& q, const Vector7& q_min,
                    const Vector7& q_max) {
  Vector7 step = Vector7::Zero();
  Vector7 rest = Vector7::Zero();  // steps of the joints taken out
  for (int taken_out = 0; taken_out <= 7; ++taken_out) {
    const double damping = 0.05 * error.squaredNorm() + 1e-7;
    const Eigen::Matrix<double, 6, 6> normal =
        jacobian * jacobian.transpose() + damping * Eigen::Matrix<double, 6, 6>::Identity();
    step = jacobian.transpose() * normal.ldlt().solve(error);
    bool inside = true;
    for (int i = 0; i < 7; ++i) {
      const double next = q[i] + step[i];
      if (jacobian.col(i).isZero() || (next >= q_min[i] && next <= q_max[i])) continue;
      rest[i] = std::clamp(next, q_min[i], q_max[i]) - q[i];
      jacobian.col(i).setZero();
      inside = false;
    }
    if (inside) break;
  }
  return step + rest;
}

Reach from(realtime::Model& model, const Vector7& q_min, const Vector7& q_max,
           const Eigen::Isometry3d& goal, Vector7 q) {
  Reach nearest;
  double nearest_error = std::numeric_limits<double>::infinity();
  q = q.cwiseMax(q_min).cwiseMin(q_max);
  for (int i = 0; i < kIterations; ++i) {
    model.update(q, Vector7::Zero());
    const Vector6 error = difference(model.O_T_EE(), goal);
    const double distance = error.head<3>().norm(), angle = error.tail<3>().norm();
    if (error.norm() < nearest_error) {
      nearest_error = error.norm();
      nearest = {distance < kDistanceTolerance && angle < kAngleTolerance, q, model.O_T_EE(), distance, angle};
    }
    if (nearest.reached) break;
    // Half a radian and 0.2 m at once is as far as the Jacobian can be trusted.
    const Vector6 bounded = error / std::max({1.0, distance / 0.2, angle / 0.5});
    const Vector7 step = damped_step(model.jacobian(), bounded, q, q_min, q_max);
    if (step.norm() < 1e-7) break;
    q = (q + step / std::max(1.0, step.norm())).cwiseMax(q_min).cwiseMin(q_max);
  }
  return nearest;
}

}  // namespace

Reach reach(realtime::Model& model, const models::Limits& limits, const Eigen::Isometry3d& O_T_EE,
            const realtime::Vector7& q) {
  Vector7 q_min, q_max;
  for (int i = 0; i < 7; ++i) {
    q_min[i] = realtime::rest_min(limits, i);
    q_max[i] = realtime::rest_max(limits, i);
  }
  Reach nearest = from(model, q_min, q_max, O_T_EE, q);
  std::mt19937 random(1);  // the same postures each time: one pose is always judged alike
  std::uniform_real_distribution<double> part(0.1, 0.9);
  int tried = 0;
  for (; tried < kPostures && !nearest.reached; ++tried) {
    Vector7 start = Eigen::Map<const Vector7>(models::kHome.data());
    if (tried > 0) {
      for (int j = 0; j < 7; ++j) start[j] = q_min[j] + part(random) * (q_max[j] - q_min[j]);
    }
    const Reach other = from(model, q_min, q_max, O_T_EE, start);
    const auto size = [](const Reach& reach) { return reach.distance + 0.3 * reach.angle; };
    if (other.reached || size(other) < size(nearest)) nearest = other;
  }
  nearest.tried = tried;
  return nearest;
}

}  // namespace server
