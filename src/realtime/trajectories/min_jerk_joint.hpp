#pragma once

#include "models/arm.hpp"
#include "realtime/trajectories/min_jerk.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// From the current reference to joint positions along a straight line of the joints, by MinJerk. Ends at
// rest at the goal. Position, velocity and acceleration are continuous from the reference it starts at.
class MinJerkJoint : public TrajectoryGenerator {
 public:
  struct Parameters {
    Vector7 q;        // rad, within the joints' range
    double duration;  // s, > 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  MinJerkJoint(const Parameters& parameters, const models::Limits& limits);

  Channels fills() const noexcept override { return Channels::kJoint; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return motion_.duration(); }
  double stretch() const noexcept override { return stretch_; }

 protected:
  MinJerkJoint(double duration, const models::Limits& limits);

  models::Limits limits_;
  Reference goal_;

 private:
  void raise_at(double t, double& worst) const noexcept;

  double asked_duration_;
  double stretch_ = 1;
  MinJerk<7> motion_;
};

}  // namespace realtime
