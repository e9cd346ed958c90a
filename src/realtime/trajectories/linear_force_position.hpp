#pragma once

#include "realtime/check.hpp"
#include "realtime/trajectories/timed_pose.hpp"

namespace realtime {

// As TimedPose with constant velocity, while the wrench that EE is to exert goes from that of the reference at the
// start to a goal, in proportion to time; there it stays.
class LinearForcePosition : public TimedPose {
 public:
  struct Parameters {
    TimedPose::Parameters pose;
    Vector3 force;   // N, -200 to 200, at EE along the axes of O
    Vector3 torque;  // N m, -50 to 50
  };

  // Throws std::invalid_argument naming field, value and bound.
  LinearForcePosition(const Parameters& parameters, const models::Limits& limits)
      : TimedPose(TimeLaw::kLinear, parameters.pose, limits) {
    for (int i = 0; i < 3; ++i) {
      require_within("force", i, parameters.force[i], -200, 200, "N");
      require_within("torque", i, parameters.torque[i], -50, 50, "N m");
    }
    goal_.wrench << parameters.force, parameters.torque;
  }

  Channels fills() const noexcept override { return Channels::kPose | Channels::kWrench; }
  void start(const Reference& from) noexcept override {
    TimedPose::start(from);
    wrench_ = from.wrench;
  }
  bool step(const Cycle& cycle, double time, Reference& reference) noexcept override {
    const bool over = TimedPose::step(cycle, time, reference);
    if (!over) reference.wrench = wrench_ + time / duration() * (goal_.wrench - wrench_);
    return over;
  }

 private:
  Vector6 wrench_ = Vector6::Zero();
};

}  // namespace realtime
