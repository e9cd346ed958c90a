#pragma once

#include "realtime/trajectories/pose_path.hpp"
#include "realtime/trajectories/samples.hpp"

namespace realtime {

// Poses of EE in O for each ms, as JointSamples; the arm is within 0.05 m and 0.2 rad of the first one.
class PoseSamples : public PosePath {
 public:
  using Positions = Eigen::Matrix<double, 3, Eigen::Dynamic>;
  using Quaternions = Eigen::Matrix<double, 4, Eigen::Dynamic>;  // w, x, y, z

  // m; one column for each, as many of both. Throws std::invalid_argument naming field, value and bound, and what to do
  // where the arm is elsewhere.
  PoseSamples(const Positions& position, const Quaternions& quaternion, const models::Limits& limits,
              const Eigen::Isometry3d& from);

 private:
  CartesianReference at(double t) const noexcept override;

  Samples<7> samples_;
};

}  // namespace realtime
