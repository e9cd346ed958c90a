#pragma once

#include "realtime/terminations/judged.hpp"
#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when the pose is within the thresholds of the trajectory's goal: position along each
// axis of O, orientation by the angle between the two.
class FinalPose : public Termination {
 public:
  struct Parameters {
    Vector3 position_threshold;    // m, >= 0
    double orientation_threshold;  // rad, >= 0
    Judged judged = Judged::kReference;
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit FinalPose(const Parameters& parameters);

  Channels judges() const noexcept override { return Channels::kPose; }
  bool seeks_goal() const noexcept override { return true; }
  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Vector3 position_threshold_;
  double orientation_threshold_;
  Judged judged_;
};

}  // namespace realtime
