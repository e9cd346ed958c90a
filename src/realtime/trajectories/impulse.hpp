#pragma once

#include <algorithm>

#include "realtime/check.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// Stays at the pose of the start and asks for a wrench W that rises and falls, in time T with ramps of t_a:
//   W(t) = W max(0, min(1, t/t_a, (T - t)/t_a))
// At EE, along and about the axes of O. How far EE may go under it is for a termination to say.
class Impulse : public TrajectoryGenerator {
 public:
  struct Parameters {
    Vector3 force;        // N, -200 to 200
    Vector3 torque;       // N m, -50 to 50
    double acc_duration;  // s, 0 to half of the duration; 0: at once
    double duration;      // s, > 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit Impulse(const Parameters& parameters) : ramp_(parameters.acc_duration), duration_(parameters.duration) {
    for (int i = 0; i < 3; ++i) {
      require_within("force", i, parameters.force[i], -200, 200, "N");
      require_within("torque", i, parameters.torque[i], -50, 50, "N m");
    }
    require_within("duration", -1, duration_, 0.001, 3600, "s");
    require_within("acc_duration", -1, ramp_, 0, duration_ / 2, "s, half of the duration");
    wrench_ << parameters.force, parameters.torque;
  }

  Channels fills() const noexcept override { return Channels::kPose | Channels::kWrench; }
  void start(const Reference& from) noexcept override { goal_ = at_rest(from); }
  bool step(const Cycle&, double time, Reference& reference) noexcept override {
    reference = goal_;
    if (time >= duration_) return true;
    const double share = ramp_ > 0 ? std::min({1.0, time / ramp_, (duration_ - time) / ramp_}) : 1;
    reference.wrench = share * wrench_;
    return false;
  }
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return duration_; }
  double stretch() const noexcept override { return 1; }

 private:
  Vector6 wrench_;
  double ramp_, duration_;
  Reference goal_;
};

}  // namespace realtime
