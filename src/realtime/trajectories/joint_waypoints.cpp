#include "realtime/trajectories/joint_waypoints.hpp"

#include <sstream>

#include "realtime/joint_range.hpp"

namespace realtime {
namespace {

auto raise_at(const models::Limits& limits, double share) {
  return [&limits, share](const CubicSpline<7>::Point& p, double& worst) {
    raise_by_joints(limits, share, p.x, p.v, p.a, p.j, worst);
  };
}

// Start and waypoints.
std::vector<Vector7> points(const JointWaypoints::Parameters& parameters, const models::Limits& limits,
                            const Vector7& from) {
  if (parameters.q.empty()) throw std::invalid_argument("q is empty: expected at least one waypoint");
  require_times(parameters.times, parameters.q.size());
  require_within("speed", -1, parameters.speed, 0.01, 1, "of the limits");
  std::vector<Vector7> points{from};
  for (std::size_t k = 0; k < parameters.q.size(); ++k) {
    for (int i = 0; i < models::kJoints; ++i) {
      require_within("waypoint " + std::to_string(k) + " of q", i, parameters.q[k][i], rest_min(limits, i),
                     rest_max(limits, i), "rad");
    }
    const bool last = k + 1 == parameters.q.size() && points.size() == 1;  // one at least
    if (parameters.times.empty() && !last && parameters.q[k] == points.back()) continue;
    points.push_back(parameters.q[k]);
  }
  return points;
}

TimedPoints<7> way(const JointWaypoints::Parameters& parameters, const models::Limits& limits, const Vector7& from) {
  const std::vector<Vector7> through = points(parameters, limits, from);
  if (parameters.times.empty()) return in_least_time(through, raise_at(limits, kMotionShare * parameters.speed));
  TimedPoints<7> way{{0}, through};
  way.times.insert(way.times.end(), parameters.times.begin(), parameters.times.end());
  return way;
}

}  // namespace

JointWaypoints::JointWaypoints(const Parameters& parameters, const models::Limits& limits, const Vector7& from)
    : JointWaypoints(parameters, limits, way(parameters, limits, from)) {}

JointWaypoints::JointWaypoints(const Parameters& parameters, const models::Limits& limits, const TimedPoints<7>& way)
    : JointPath(limits), spline_(way.times, way.points) {
  // Waypoints lie within the range, and still the spline may bow out of it.
  for (std::size_t k = 1; k < way.times.size(); ++k) {
    double none = 0;
    raise_in_segment(spline_, way.times[k - 1], way.times[k], none, [&](const auto& point, double&) {
      for (int i = 0; i < models::kJoints; ++i) {
        const double low = std::min(rest_min(limits, i), way.points[0][i]),
                     high = std::max(rest_max(limits, i), way.points[0][i]);
        if (point.x[i] >= low && point.x[i] <= high) continue;
        std::ostringstream text;
        text << "joint " << i + 1 << " would be at " << point.x[i] << " rad before waypoint " << (k - 1) / way.first
             << ": expected " << low << " to " << high << " rad, so add a waypoint between, or give it more time";
        throw std::invalid_argument(text.str());
      }
    });
  }
  const bool timed = !parameters.times.empty();
  const double factor =
      keep_limits(spline_, way.times, raise_at(limits, kMotionShare * (timed ? 1 : parameters.speed)));
  if (timed) stretch_ = factor;
  length_ = spline_.duration();
  clear_after_ = factor * way.times[way.first];
  goal_.joint.q = parameters.q.back();
}

JointReference JointWaypoints::at(double t) const noexcept {
  const auto point = spline_.at(t);
  return {point.x, point.v, point.a};
}

}  // namespace realtime
