#pragma once

#include <memory>

#include "models/arm.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// As TimeOptimalJoint, to a pose of EE in O: each axis of position and of the rotation vector relative to the goal has a
// share of the arm's Cartesian limits that keeps the norms; on a line where it begins at rest.
class TimeOptimalPose : public TrajectoryGenerator {
 public:
  struct Parameters {
    Vector3 position;                // m, in O
    Eigen::Quaterniond orientation;  // in O
    double speed;                    // share of the limits, 0.01 to 1
  };

  // Throws std::invalid_argument naming field, value and bound.
  TimeOptimalPose(const Parameters& parameters, const models::Limits& limits);
  ~TimeOptimalPose() override;

  Channels fills() const noexcept override { return Channels::kPose; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return duration_; }
  double stretch() const noexcept override { return 1; }

 private:
  struct Planner;
  std::unique_ptr<Planner> planner_;
  double duration_ = 0;
  Reference goal_;
};

}  // namespace realtime
