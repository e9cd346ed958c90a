#pragma once

#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when every commanded joint is within its threshold of the trajectory's goal.
class FinalJoint : public Termination {
 public:
  struct Parameters {
    Vector7 threshold;  // rad, >= 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit FinalJoint(const Parameters& parameters);

  bool accepts(ReferenceKind kind) const noexcept override { return kind == ReferenceKind::kJoint; }
  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Vector7 threshold_;
};

}  // namespace realtime
