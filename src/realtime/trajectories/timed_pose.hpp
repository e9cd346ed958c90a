#pragma once

#include "models/arm.hpp"
#include "realtime/trajectories/time_law.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// From the current reference to a pose of EE in O by a time law: the position along a line, the orientation along the
// shortest rotation (its rotation vector relative to the start follows the law). Otherwise as TimedJoint.
class TimedPose : public TrajectoryGenerator {
 public:
  struct Parameters {
    Vector3 position;                // m, in O
    Eigen::Quaterniond orientation;  // in O
    double duration;                 // s, > 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  TimedPose(TimeLaw law, const Parameters& parameters, const models::Limits& limits);

  Channels fills() const noexcept override { return Channels::kPose; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return duration_; }
  double stretch() const noexcept override { return duration_ / asked_duration_; }

 protected:
  TimedPose(TimeLaw law, double duration, const models::Limits& limits);

  Reference goal_;

 private:
  TimeLaw law_;
  models::Limits limits_;
  double asked_duration_, duration_;
  CartesianReference from_;
  Vector3 turn_ = Vector3::Zero();  // rotation vector from start to goal, in O
};

}  // namespace realtime
