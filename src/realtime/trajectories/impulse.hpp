#pragma once

#include <algorithm>

#include "realtime/check.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// Stays at the pose of the start and asks for a wrench that goes from that of the reference there, W_0, to W and then to zero, in
// time T with ramps of t_a:
//   W(t) = min(1, t/t_a, (T - t)/t_a) W + max(0, 1 - t/t_a) W_0
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
  void start(const Reference& from) noexcept override {
    goal_ = at_rest(from);
    before_ = from.wrench;
    goal_.wrench.setZero();
  }
  bool step(const Cycle&, double time, Reference& reference) noexcept override {
    reference = goal_;
    if (time >= duration_) return true;
    const double risen = ramp_ > 0 ? std::min(1.0, time / ramp_) : 1, left = ramp_ > 0 ? std::min(1.0, (duration_ - time) / ramp_) : 1;
    reference.wrench = std::min(risen, left) * wrench_ + (1 - risen) * before_;
    return false;
  }
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return duration_; }
  double stretch() const noexcept override { return 1; }

 private:
  Vector6 wrench_, before_ = Vector6::Zero();
  double ramp_, duration_;
  Reference goal_;
};

}  // namespace realtime
