#pragma once

#include <optional>

#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when the robot reports contact: its estimate of the external wrench, or of a joint's external torque, is above
// the lower threshold of its collision behaviour (libfranka's RobotState::cartesian_contact, joint_contact).
class Contact : public Termination {
 public:
  struct Parameters {
    bool cartesian, joint;  // at least one of the two
    // Lower thresholds that the robot is set to for the skill, with those of franka-interface for what is not given and
    // as upper ones; none: the robot's stay.
    std::optional<Vector6> force_thresholds;   // N, N m; 0 to the upper ones
    std::optional<Vector7> torque_thresholds;  // N m; 0 to the upper ones
  };

  // Throws std::invalid_argument naming field, value and bound, or when neither flag is asked for.
  explicit Contact(const Parameters& parameters);

  robot::Settings settings() const noexcept override { return settings_; }
  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  bool cartesian_, joint_;
  robot::Settings settings_;
};

}  // namespace realtime
