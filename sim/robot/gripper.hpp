#pragma once

#include <array>
#include <optional>

#include "wire/fci/gripper.hpp"

namespace sim {

// The hand's own controller: moves the fingers' common reference at the speed asked for, with a spring between it and
// the fingers whose force is bounded. A bounded spring pulled against something is a grip.
class Gripper {
 public:
  using Status = fci::gripper::Status;

  // With its fingers opened so far, m each.
  explicit Gripper(const std::array<double, 2>& finger);

  // Begin; an outcome (kFail: no value, or none that the hand can do) ends it. What was under way is aborted by the
  // caller.
  void home();
  void move(const fci::gripper::Move& request);
  void grasp(const fci::gripper::Grasp& request);
  // The fingers stay where they are, and press no longer: what they hold is let go.
  void stop();

  // One cycle: force of each finger (N, > 0 opens) from its opening (m).
  std::array<double, 2> control(const std::array<double, 2>& finger);

  bool under_way() const { return task_ != Task::kHold; }
  // How the last command ended; empty while it is under way.
  std::optional<Status> outcome() const { return outcome_; }
  const fci::gripper::State& state() const { return state_; }

 private:
  enum class Task { kHold, kHome, kMove, kGrasp };
  void begin(Task task, double opening, double speed, double force);
  void follow_up(double position, double velocity);
  void refuse();
  void end(Status outcome);

  Task task_ = Task::kHold;
  fci::gripper::Grasp grasp_;
  std::optional<Status> outcome_;
  bool gripping_ = false;    // a grasp has ended well
  double goal_;              // of the reference, m for each finger
  double reference_;         // m for each finger
  double reach_ = 0;         // m that it may be from the fingers
  double speed_ = 0;         // of the reference, m/s
  double force_;             // bound, N
  double temperature_;       // °C
  int still_ = 0;            // cycles in which the fingers have not moved
  std::array<double, 2> before_;  // m, opened so far
  fci::gripper::State state_;
};

}  // namespace sim
