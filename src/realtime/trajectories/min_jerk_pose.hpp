#pragma once

#include "models/arm.hpp"
#include "realtime/trajectories/min_jerk.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// From the current reference to a pose of EE in O: the position along a straight line by MinJerk, the
// orientation along the shortest rotation, as MinJerk in its rotation vector relative to the goal
// (R = exp(r) R_goal). Beginning with an angular velocity that is not along that rotation, it leaves the
// shortest rotation while this decays. Ends at rest at the goal. Pose, velocity and acceleration are
// continuous from the reference it starts at.
class MinJerkPose : public TrajectoryGenerator {
 public:
  struct Parameters {
    Vector3 position;                // m, in O
    Eigen::Quaterniond orientation;  // in O
    double duration;                 // s, > 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  MinJerkPose(const Parameters& parameters, const models::Limits& limits);

  Channels fills() const noexcept override { return Channels::kPose; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return std::max(translation_.duration(), rotation_.duration()); }
  double stretch() const noexcept override { return stretch_; }

 protected:
  MinJerkPose(double duration, const models::Limits& limits);

  Reference goal_;

 private:
  void set_duration(double T) noexcept;

  models::Limits limits_;
  double asked_duration_;
  double stretch_ = 1;
  MinJerk<3> translation_, rotation_;
};

}  // namespace realtime
