#include "realtime/trajectories/pose_waypoints.hpp"

#include "realtime/trajectories/pose_difference.hpp"

namespace realtime {
namespace {

auto raise_at(const models::Limits& limits, double share) {
  return [&limits, share](const CubicSpline<7>::Point& p, double& worst) {
    const CartesianReference pose = pose_of(p.x, p.v, p.a);
    const auto raise_by = [&](const Vector3& v, const Vector3& a, double j, const models::Limits::Rates& most) {
      raise(worst, v.norm() / (share * most.velocity), a.norm() / (share * most.acceleration), j / (share * most.jerk));
    };
    raise_by(pose.velocity.head<3>(), pose.acceleration.head<3>(), p.j.head<3>().norm(), limits.translation);
    raise_by(pose.velocity.tail<3>(), pose.acceleration.tail<3>(), 2 * p.j.tail<4>().norm() / p.x.tail<4>().norm(),
             limits.rotation);
  };
}

// Start and waypoints.
std::vector<Vector7> points(const PoseWaypoints::Parameters& parameters, const Eigen::Isometry3d& from) {
  require_same_size(parameters.position.size(), parameters.orientation.size());
  require_times(parameters.times, parameters.position.size());
  require_within("speed", -1, parameters.speed, 0.01, 1, "of the limits");
  std::vector<Vector7> points{coordinates(from.translation(), Eigen::Quaterniond(from.linear()).normalized())};
  for (std::size_t k = 0; k < parameters.position.size(); ++k) {
    for (int i = 0; i < 3; ++i) {
      require_within("waypoint " + std::to_string(k) + " of position", i, parameters.position[k][i], -2, 2, "m");
    }
    const Vector7 point = nearer(
        coordinates(parameters.position[k], require_rotation("quaternion", parameters.orientation[k])), points.back());
    const bool last = k + 1 == parameters.position.size() && points.size() == 1;  // one at least
    if (parameters.times.empty() && !last && point.isApprox(points.back())) continue;
    points.push_back(point);
  }
  return points;
}

TimedPoints<7> way(const PoseWaypoints::Parameters& parameters, const models::Limits& limits,
                   const Eigen::Isometry3d& from) {
  const std::vector<Vector7> through = points(parameters, from);
  if (parameters.times.empty()) return in_least_time(through, raise_at(limits, kMotionShare * parameters.speed));
  TimedPoints<7> way{{0}, through};
  way.times.insert(way.times.end(), parameters.times.begin(), parameters.times.end());
  return way;
}

}  // namespace

PoseWaypoints::PoseWaypoints(const Parameters& parameters, const models::Limits& limits, const Eigen::Isometry3d& from)
    : PoseWaypoints(parameters, limits, way(parameters, limits, from)) {}

PoseWaypoints::PoseWaypoints(const Parameters& parameters, const models::Limits& limits, const TimedPoints<7>& way)
    : PosePath(limits), spline_(way.times, way.points) {
  const bool timed = !parameters.times.empty();
  const double factor =
      keep_limits(spline_, way.times, raise_at(limits, kMotionShare * (timed ? 1 : parameters.speed)));
  if (timed) stretch_ = factor;
  length_ = spline_.duration();
  clear_after_ = factor * way.times[way.first];
  goal_.cartesian = pose_of(spline_.at(length_).x, Vector7::Zero(), Vector7::Zero());
}

CartesianReference PoseWaypoints::at(double t) const noexcept {
  const auto point = spline_.at(t);
  return pose_of(point.x, point.v, point.a);
}

}  // namespace realtime
