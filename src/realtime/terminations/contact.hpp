#pragma once

#include <optional>

#include "realtime/terminations/termination.hpp"
#include "robot/collision_behavior.hpp"

namespace realtime {

// Ends at a contact: when the size of a component of the external wrench, or of a joint's external torque, is above its
// threshold, by the robot's estimate (O_F_ext_hat_K, tau_ext_hat_filtered) or by the momentum observer's. Of the robot's without
// thresholds: when the robot reports a contact, because its estimate is above the lower threshold of its collision behaviour
// (libfranka's RobotState::cartesian_contact, joint_contact). Thresholds are looked at here and the robot does not learn of them,
// so that it need not rest to be told; above the upper ones of its collision behaviour it stops by its own reflex all the same.
class Contact : public Termination {
 public:
  enum class Estimate { kRobot, kObserver };

  struct Parameters {
    bool cartesian, joint;  // what is looked at: at least one of the two
    // With one given, the other is the lower one of `reflex`, the thresholds of the robot; at most its upper ones. Of the observer
    // what is not given is MomentumObserver's.
    std::optional<Vector6> force_thresholds;   // N, N m; >= 0
    std::optional<Vector7> torque_thresholds;  // N m; >= 0
    Estimate estimate = Estimate::kRobot;
  };

  // Throws std::invalid_argument naming field, value and bound, or when neither is looked at.
  explicit Contact(const Parameters& parameters, SoftEnding then = {},
                   const fci::SetCollisionBehavior& reflex = robot::kCollisionBehavior);

  SoftEnding* then() noexcept override { return &then_; }
  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Parameters parameters_;
  SoftEnding then_;
};

}  // namespace realtime
