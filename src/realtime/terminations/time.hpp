#pragma once

#include <optional>

#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends at a time of the skill, or a while after its trajectory is over (wherever a stretch put that).
class Time : public Termination {
 public:
  struct Parameters {                        // one of the two
    std::optional<double> seconds;           // s, >= 0
    std::optional<double> after_trajectory;  // s, >= 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit Time(const Parameters& parameters);

  void start() noexcept override;
  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Parameters parameters_;
  double over_since_ = -1;  // s of skill time; negative: not over
  double began_ = -1;       // s likewise: the trajectory that is over; where the skill is changed another begins
};

}  // namespace realtime
