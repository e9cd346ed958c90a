#pragma once

#include <vector>

#include "realtime/trajectories/joint_path.hpp"
#include "realtime/trajectories/waypoint_times.hpp"

namespace realtime {

// Through joint positions to the last one, where it rests, along a CubicSpline from where the skill was built for; see
// JointPath for where it then begins. At the given times, all stretched by one factor where the limits ask for it; or,
// with none, in about the least time that a share of the limits allows on such a spline (waypoints that are equal to
// the one before are then left out). Each waypoint is passed exactly.
class JointWaypoints : public JointPath {
 public:
  struct Parameters {
    std::vector<Vector7> q;     // rad
    std::vector<double> times;  // s since the start, one for each waypoint, or none
    double speed;               // without times: share of the limits, 0.01 to 1
  };

  // `from`: rad. Throws std::invalid_argument naming field, value and bound, and where the spline leaves the joints'
  // range.
  JointWaypoints(const Parameters& parameters, const models::Limits& limits, const Vector7& from);

 private:
  JointWaypoints(const Parameters& parameters, const models::Limits& limits, const TimedPoints<7>& way);
  JointReference at(double t) const noexcept override;

  CubicSpline<7> spline_;
};

}  // namespace realtime
