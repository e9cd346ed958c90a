#pragma once

#include <memory>

#include "models/arm.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// From the current reference, moving or not, to joint positions in the least time that a share of the arm's limits of
// velocity, acceleration and jerk allows; all joints arrive together. (Berscheid, Kröger, Jerk-limited Real-time Trajectory
// Generation with Arbitrary Target States, RSS 2021; Ruckig.)
class TimeOptimalJoint : public TrajectoryGenerator {
 public:
  struct Parameters {
    Vector7 q;     // rad
    double speed;  // share of the limits, 0.01 to 1
  };

  // Throws std::invalid_argument naming field, value and bound.
  TimeOptimalJoint(const Parameters& parameters, const models::Limits& limits);
  ~TimeOptimalJoint() override;

  Channels fills() const noexcept override { return Channels::kJoint; }
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
