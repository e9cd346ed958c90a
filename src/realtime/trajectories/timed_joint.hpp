#pragma once

#include "models/arm.hpp"
#include "realtime/trajectories/time_law.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// From the current reference to joint positions by a time law, the same for all joints. Where the law does not begin with
// the velocity of the reference, or jumps, the limiter makes of it what the arm can do.
class TimedJoint : public TrajectoryGenerator {
 public:
  struct Parameters {
    Vector7 q;        // rad
    double duration;  // s, > 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  TimedJoint(TimeLaw law, const Parameters& parameters, const models::Limits& limits);

  Channels fills() const noexcept override { return Channels::kJoint; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return duration_; }
  double stretch() const noexcept override { return duration_ / asked_duration_; }

 private:
  TimeLaw law_;
  models::Limits limits_;
  double asked_duration_, duration_;
  JointReference from_;
  Reference goal_;
};

}  // namespace realtime
