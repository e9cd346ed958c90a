#pragma once

#include <Eigen/Geometry>

#include "models/arm.hpp"
#include "realtime/trajectories/min_jerk.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// Along a path of poses of EE in O that was made for a start; what differs when it begins fades away as with JointPath,
// that of the orientation in its rotation vector, R = exp(r) R_path.
class PosePath : public TrajectoryGenerator {
 public:
  Channels fills() const noexcept override { return Channels::kPose; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return std::max(wait_ + length_, translation_.duration()); }
  double stretch() const noexcept override { return stretch_; }

 protected:
  explicit PosePath(const models::Limits& limits) : limits_(limits) { goal_.motion = Channels::kPose; }

  // At t s since its start, 0 to length_.
  virtual CartesianReference at(double t) const noexcept = 0;

  models::Limits limits_;
  Reference goal_;
  // As of JointPath.
  double length_ = 0, stretch_ = 1, clear_after_ = 0;

 private:
  MinJerk<3> translation_, rotation_;
  double wait_ = 0;
};

// Throws std::invalid_argument unless there are as many positions as quaternions, at least one.
void require_same_size(std::size_t positions, std::size_t quaternions);

// A pose in seven coordinates that a spline or any other law may interpolate: position, and the orientation as a
// quaternion w, x, y, z of any norm, which turns along the shortest way when it goes straight.
Vector7 coordinates(const Vector3& position, const Eigen::Quaterniond& orientation) noexcept;

// The same with that sign of the quaternion that is nearer to `to`.
Vector7 nearer(const Vector7& coordinates, const Vector7& to) noexcept;

// Back, with the derivatives.
CartesianReference pose_of(const Vector7& x, const Vector7& v, const Vector7& a) noexcept;

}  // namespace realtime
