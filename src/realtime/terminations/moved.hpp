#pragma once

#include <optional>

#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when the measured pose of EE is a distance, or an angle, away from where it was when the skill began: straight,
// not along the path, to which noise would add.
class Moved : public Termination {
 public:
  struct Parameters {                // at least one of the two; with both either will do
    std::optional<double> distance;  // m, > 0
    std::optional<double> angle;     // rad, > 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit Moved(const Parameters& parameters);

  void start() noexcept override { begun_ = false; }
  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Parameters parameters_;
  bool begun_ = false;
  Eigen::Isometry3d from_ = Eigen::Isometry3d::Identity();
};

}  // namespace realtime
