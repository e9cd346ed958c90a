#pragma once

#include <optional>

#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends when the force, or the torque, that the robot estimates at the stiffness frame K is above a threshold: along an
// axis in either direction, or its magnitude.
class WrenchAbove : public Termination {
 public:
  enum class Part { kForce, kTorque };
  enum class Frame { kBase, kStiffness };  // whose axes: O_F_ext_hat_K, K_F_ext_hat_K

  struct Parameters {
    Part part;
    double threshold;             // N or N m, >= 0
    std::optional<Vector3> axis;  // any length but 0; none: the magnitude
    Frame frame;
    bool relative;                // to the estimate when the skill began
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit WrenchAbove(const Parameters& parameters);

  void start() noexcept override { begun_ = false; }
  bool step(const Cycle& cycle, const Progress& progress) noexcept override;

 private:
  Parameters parameters_;
  bool begun_ = false;
  Vector3 bias_ = Vector3::Zero();
};

}  // namespace realtime
