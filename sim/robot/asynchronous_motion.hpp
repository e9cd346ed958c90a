#pragma once

#include <Eigen/Core>
#include <ruckig/ruckig.hpp>

#include "models/arm.hpp"
#include "sim/robot/dt.hpp"

namespace sim {

// The motion of a robot that is given targets and not a path (version 10's asynchronous motion generator): from how the
// joints are desired to move now to rest at the newest target, as fast as the limits and the client's velocities allow.
class AsynchronousMotion {
 public:
  using Vector7 = Eigen::Matrix<double, 7, 1>;

  // Begins at rest at q (rad) and stays there until there is a target. maximum_velocity: rad/s, > 0, of each joint.
  void start(const models::Limits& limits, const Vector7& q, const models::Vector7& maximum_velocity);
  // rad; where the limits let every joint move in both directions.
  void aim(const models::Vector7& target);
  // q_d after another cycle, rad.
  models::Vector7 step();
  // At rest at the target.
  bool arrived() const { return arrived_; }

 private:
  const models::Limits* limits_ = nullptr;
  models::Vector7 maximum_velocity_{};
  ruckig::Ruckig<7> generator_{kDt};
  ruckig::InputParameter<7> input_;
  ruckig::OutputParameter<7> output_;
  bool arrived_ = true;
};

}  // namespace sim
