#include "sim/robot/asynchronous_motion.hpp"

#include <algorithm>

namespace sim {

void AsynchronousMotion::start(const models::Limits& limits, const Vector7& q,
                               const models::Vector7& maximum_velocity) {
  limits_ = &limits;
  maximum_velocity_ = maximum_velocity;
  generator_.reset();
  input_ = {};
  input_.max_acceleration = limits.ddq_max;
  input_.max_jerk = limits.dddq_max;
  Vector7::Map(input_.current_position.data()) = q;
  aim(input_.current_position);
}

// FR3's velocities end where its joints' ranges do: the way to a target is nowhere slower than the target itself.
void AsynchronousMotion::aim(const models::Vector7& target) {
  input_.target_position = target;
  models::Vector7 lowest;
  for (int i = 0; i < models::kJoints; ++i) {
    input_.max_velocity[i] = std::min(maximum_velocity_[i], limits_->dq_upper(i, target[i]));
    lowest[i] = std::max(-maximum_velocity_[i], limits_->dq_lower(i, target[i]));
  }
  input_.min_velocity = lowest;
  arrived_ = false;
}

models::Vector7 AsynchronousMotion::step() {
  arrived_ = generator_.update(input_, output_) != ruckig::Result::Working;
  output_.pass_to_input(input_);
  return input_.current_position;
}

}  // namespace sim
