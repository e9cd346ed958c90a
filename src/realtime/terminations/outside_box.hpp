#pragma once

#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when the measured origin of EE is outside of a box along the axes of O.
class OutsideBox : public Termination {
 public:
  struct Parameters {
    Vector3 lower, upper;  // corners, m; lower < upper
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit OutsideBox(const Parameters& parameters);

  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Parameters parameters_;
};

}  // namespace realtime
