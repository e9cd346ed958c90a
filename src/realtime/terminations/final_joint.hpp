#pragma once

#include "realtime/terminations/judged.hpp"
#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when every joint is within its threshold of the trajectory's goal.
class FinalJoint : public Termination {
 public:
  struct Parameters {
    Vector7 threshold;  // rad, >= 0
    Judged judged = Judged::kReference;
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit FinalJoint(const Parameters& parameters);

  Channels judges() const noexcept override { return Channels::kJoint; }
  bool seeks_goal() const noexcept override { return true; }
  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Vector7 threshold_;
  Judged judged_;
};

}  // namespace realtime
