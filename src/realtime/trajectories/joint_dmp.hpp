#pragma once

#include "models/arm.hpp"
#include "realtime/trajectories/dmp_sensors.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// A movement primitive of each joint (dmp.hpp), with the first basis function kMinJerk. Begins at the reference with
// its velocity; its acceleration there is that of the springs, so that the limiter rounds it. It is cut off after its
// duration; joints that still move then decay to rest. As a whole it is made slower where the learned motion breaks the
// limits of velocity, acceleration and jerk; FR3's envelope, what a velocity at the start adds, and what values of sensors
// that come while it runs make of it, are left to the limiter.
class JointDmp : public TrajectoryGenerator {
 public:
  struct Parameters {
    DmpSpring spring;
    DmpForce force;   // rad; sensor values are the same for all joints
    double duration;  // s, 0.001 to 120
  };

  // Throws std::invalid_argument naming field, value and bound.
  JointDmp(const Parameters& parameters, const models::Limits& limits);

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return rollout_.inputs(); }
  Channels fills() const noexcept override { return Channels::kJoint; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  bool shortened() const noexcept override { return shortened_; }
  double duration() const noexcept override { return motion_.duration(); }
  double stretch() const noexcept override { return slower_; }

 private:
  void set_goal(const Vector7& q) noexcept;

  models::Limits limits_;
  DmpSensors<7> rollout_;
  double slower_ = 1;
  DmpMotion<7, DmpSensors<7>> motion_;
  Reference goal_;
  bool shortened_ = false;
};

}  // namespace realtime
