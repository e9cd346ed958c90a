#pragma once

#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when every measured joint velocity has been below a threshold for a while: the arm has come to rest, be it against
// something.
class VelocityBelow : public Termination {
 public:
  struct Parameters {
    double threshold;  // rad/s, > 0
    double duration;   // s, >= 0
    double after;      // s of the skill that are not looked at, >= 0: it begins at rest
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit VelocityBelow(const Parameters& parameters);

  void start() noexcept override { slow_ = 0; }
  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Parameters parameters_;
  double slow_ = 0;  // s
};

}  // namespace realtime
