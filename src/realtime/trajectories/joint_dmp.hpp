#pragma once

#include "models/arm.hpp"
#include "realtime/trajectories/dmp.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// A movement primitive of each joint (dmp.hpp), with the first basis function kMinJerk. Begins at the reference with
// its velocity; its acceleration there is that of the springs, so that the limiter rounds it. It is cut off after its
// duration; joints that still move then decay to rest. As a whole it is made slower where the learned motion breaks the
// limits of velocity, acceleration and jerk; FR3's envelope, and what a velocity at the start adds, are left to the
// limiter.
class JointDmp : public TrajectoryGenerator {
 public:
  struct Parameters {
    DmpSpring spring;
    DmpForce force;   // rad; sensor values are the same for all joints
    double duration;  // s, 0.001 to 120
  };

  // Throws std::invalid_argument naming field, value and bound.
  JointDmp(const Parameters& parameters, const models::Limits& limits);

  Channels fills() const noexcept override { return Channels::kJoint; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  bool shortened() const noexcept override { return shortened_; }
  double duration() const noexcept override { return motion_.duration(); }
  double stretch() const noexcept override { return slower_; }

 private:
  models::Limits limits_;
  DmpRollout<7> rollout_;
  double slower_ = 1;
  DmpMotion<7> motion_;
  Reference goal_;
  bool shortened_ = false;
};

}  // namespace realtime
