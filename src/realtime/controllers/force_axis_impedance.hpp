#pragma once

#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/controllers/motion_cap.hpp"

namespace realtime {

// Exerts the part of the trajectory's wrench that is a force along an axis, and keeps EE on the line through where it began
// and in its orientation with springs (CartesianImpedance, which has no stiffness along the axis then):
//   tau_J_d = share J^T [a a^T force; 0] + tau_spring
// a of length 1 in O. `share` is 1, and falls to 0 where EE has moved as far as it may (MotionCap).
class ForceAxisImpedance : public Controller {
 public:
  struct Parameters {
    Vector3 axis;                    // in O, any length but 0
    double translational_stiffness;  // N/m across the axis, 0 to 3000
    double rotational_stiffness;     // N m/rad, 0 to 300
    double max_translation;          // m, 0 to 2; 0: no cap
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit ForceAxisImpedance(const Parameters& parameters);

  Channels takes() const noexcept override { return Channels::kJoint | Channels::kPose | Channels::kWrench; }
  bool tracks() const noexcept override { return false; }
  bool leads() const noexcept override { return false; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }

  // The line goes through where the springs ask for the torque that is there; the trajectory's reference is not followed.
  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

 private:
  Cycle at_posture(const Cycle& cycle) const noexcept;

  Vector3 axis_;
  MotionCap cap_;
  CartesianImpedance spring_;
  Reference line_;
  Vector7 posture_ = Vector7::Zero();  // rad, that the elbow is held to
};

}  // namespace realtime
