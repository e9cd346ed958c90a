#pragma once

#include <vector>

#include "realtime/trajectories/pose_path.hpp"
#include "realtime/trajectories/waypoint_times.hpp"

namespace realtime {

// Through poses of EE in O to the last one, as JointWaypoints: position and the four numbers of a quaternion along one
// CubicSpline, for the norms of the Cartesian limits. Between two poses alone it turns the shortest way.
class PoseWaypoints : public PosePath {
 public:
  struct Parameters {
    std::vector<Vector3> position;                // m, in O
    std::vector<Eigen::Quaterniond> orientation;  // in O; as many
    std::vector<double> times;                    // s since the start, one for each waypoint, or none
    double speed;                                 // without times: share of the limits, 0.01 to 1
  };

  // Throws std::invalid_argument naming field, value and bound.
  PoseWaypoints(const Parameters& parameters, const models::Limits& limits, const Eigen::Isometry3d& from);

 private:
  PoseWaypoints(const Parameters& parameters, const models::Limits& limits, const TimedPoints<7>& way);
  CartesianReference at(double t) const noexcept override;

  CubicSpline<7> spline_;
};

}  // namespace realtime
