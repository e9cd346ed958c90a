#pragma once

#include <memory>
#include <utility>

#include "realtime/check.hpp"
#include "realtime/slow.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// Another trajectory on a slower clock: x(t) = x'(speed t). It begins at rest, so that a fast motion which it takes over from
// is braked by the limiter and not on the slow clock, which would lead it astray.
class Slowed : public TrajectoryGenerator {
 public:
  // speed: 0.01 to 1. Throws std::invalid_argument naming value and bound.
  Slowed(std::unique_ptr<TrajectoryGenerator> trajectory, double speed) : trajectory_(std::move(trajectory)), speed_(speed) {
    require_within("speed", -1, speed, 0.01, 1, "");
  }

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return trajectory_->sensor_inputs(); }
  ReferenceKind reference_kind() const noexcept override { return trajectory_->reference_kind(); }
  Effort effort() const noexcept override { return trajectory_->effort(); }
  void start(const Reference& from) noexcept override { trajectory_->start(at_rest(from)); }
  bool step(double time, Reference& reference) noexcept override {
    const bool over = trajectory_->step(speed_ * time, reference);
    slow(reference, speed_, 0);
    return over;
  }
  const Reference& goal() const noexcept override { return trajectory_->goal(); }
  bool shortened() const noexcept override { return trajectory_->shortened(); }
  double duration() const noexcept override { return trajectory_->duration() / speed_; }
  double stretch() const noexcept override { return trajectory_->stretch(); }

 private:
  std::unique_ptr<TrajectoryGenerator> trajectory_;
  double speed_;
};

}  // namespace realtime
