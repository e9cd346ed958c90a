#include "realtime/trajectories/pose_samples.hpp"

#include <limits>
#include <sstream>
#include <stdexcept>

#include "realtime/rotation.hpp"

namespace realtime {
namespace {

constexpr double kNearPose = 0.05;  // m
constexpr double kAligned = 0.2;    // rad

Samples<7>::Table table(const PoseSamples::Positions& position, const PoseSamples::Quaternions& quaternion) {
  require_same_size(static_cast<std::size_t>(position.cols()), static_cast<std::size_t>(quaternion.cols()));
  Samples<7>::Table table(7, position.cols());
  for (Eigen::Index k = 0; k < position.cols(); ++k) {
    for (int i = 0; i < 3; ++i) {
      const double x = position(i, k);
      if (!(x >= -2 && x <= 2)) require_within("sample " + std::to_string(k) + " of position", i, x, -2, 2, "m");
    }
    const double norm = quaternion.col(k).norm();
    if (!(norm >= 0.999 && norm <= 1.001)) {
      require_within("norm of sample " + std::to_string(k) + " of quaternion", -1, norm, 0.999, 1.001, "");
    }
    Vector7 x;
    x << position.col(k), quaternion.col(k) / norm;
    table.col(k) = k == 0 ? x : nearer(x, table.col(k - 1));
  }
  return table;
}

}  // namespace

PoseSamples::PoseSamples(const Positions& position, const Quaternions& quaternion, const models::Limits& limits,
                         const Eigen::Isometry3d& from)
    : PosePath(limits), samples_(table(position, quaternion)) {
  const CartesianReference first = at(0);
  const double distance = (first.position - from.translation()).norm();
  const double angle = log(first.orientation * Eigen::Quaterniond(from.linear()).conjugate()).norm();
  if (distance > kNearPose || angle > kAligned) {
    std::ostringstream text;
    text << "the first sample is " << distance << " m and " << angle
         << " rad from where the arm is: move it there before, "
         << "within " << kNearPose << " m and " << kAligned << " rad";
    throw std::invalid_argument(text.str());
  }
  samples_.visit_rates([&](const Vector7&, const Vector7& v, const Vector7& a) {
    const auto raise_by = [&](double velocity, double acceleration, const models::Limits::Rates& most) {
      raise(stretch_, velocity / (kMotionShare * most.velocity), acceleration / (kMotionShare * most.acceleration), 0);
    };
    raise_by(v.head<3>().norm(), a.head<3>().norm(), limits.translation);
    raise_by(2 * v.tail<4>().norm(), 2 * a.tail<4>().norm(), limits.rotation);
  });
  length_ = stretch_ * samples_.duration();
  clear_after_ = std::numeric_limits<double>::infinity();
  goal_.cartesian = pose_of(samples_.table().col(position.cols() - 1), Vector7::Zero(), Vector7::Zero());
}

CartesianReference PoseSamples::at(double t) const noexcept {
  const auto point = samples_.at(t / stretch_);
  return pose_of(point.x, point.v / stretch_, point.a / (stretch_ * stretch_));
}

}  // namespace realtime
