#pragma once

#include <optional>

#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends at a contact. Without thresholds: when the robot reports one, because its estimate of the external wrench, or of a
// joint's external torque, is above the lower threshold of its collision behaviour (libfranka's
// RobotState::cartesian_contact, joint_contact). With thresholds: when the size of a component of O_F_ext_hat_K, or of
// tau_ext_hat_filtered, is above its own. They are looked at here and the robot does not learn of them, so that it need not
// rest to be told; above the upper thresholds of its collision behaviour it stops by its own reflex all the same.
class Contact : public Termination {
 public:
  struct Parameters {
    bool cartesian, joint;  // what is looked at: at least one of the two
    // With one given, the other is the lower one of robot::kCollisionBehavior; at most its upper ones.
    std::optional<Vector6> force_thresholds;   // N, N m; >= 0
    std::optional<Vector7> torque_thresholds;  // N m; >= 0
  };

  // Throws std::invalid_argument naming field, value and bound, or when neither is looked at.
  explicit Contact(const Parameters& parameters);

  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Parameters parameters_;
};

}  // namespace realtime
