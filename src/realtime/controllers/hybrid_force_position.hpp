#pragma once

#include <array>

#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/controllers/force_servo.hpp"

namespace realtime {

// Force along some axes of a frame and motion along the others, in operational space (Khatib, A unified approach for motion
// and force control of robot manipulators, IEEE J. Robotics and Automation 3(1), 1987, eqs. 36 to 47):
//   tau_J_d = J^T (F_motion + F_force) + coriolis + tau_null
// F_motion is CartesianImpedance without stiffness and without desired motion along the force axes, so that Lambda decouples
// the two: spring and damper pull across them alone, and F_motion has along them what their inertia needs to stay. F_force
// is a ForceServo for each force axis, on what the robot estimates that EE exerts, at EE. The force wanted is a constant of
// the skill and the wrench of its trajectory added.
//
// Along a force axis EE goes where the surroundings let it: with nothing to touch at the speed that is allowed.
class HybridForcePosition : public Controller {
 public:
  using Frame = CartesianImpedance::Frame;

  struct Parameters {
    Vector6 force_axes;               // 1 for force along, or torque about, this axis of the frame; 0 for motion
    Vector6 force;                    // that EE exerts, in the frame; N, -100 to 100, and N m, -20 to 20; of force axes
    Frame frame;                      // EE: its measured axes, turning with it
    Vector3 translational_stiffness;  // N/m, 0 to 3000, of the other axes
    Vector3 rotational_stiffness;     // N m/rad, 0 to 300
    double damping_ratio;             // 0.1 to 3
    double nullspace_stiffness;       // N m/rad, 0 to 100
    double gain;                      // of the force that is missing, 0 to 2
    double integral_gain;             // 1/s, 0 to 20
    double max_speed;                 // m/s, 0.001 to 0.2, along force axes in free space
    double max_turning_speed;         // rad/s, 0.01 to 1
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit HybridForcePosition(const Parameters& parameters);

  Channels takes() const noexcept override { return Channels::kPose | Channels::kWrench; }
  // With a force axis the arm leaves its reference.
  bool tracks() const noexcept override { return tracks_; }
  bool leads() const noexcept override { return false; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }

  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void stay() noexcept override { motion_.stay(); }
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

 private:
  Reference of_motion(const Cycle& cycle, const Reference& reference) const noexcept;

  Parameters parameters_;
  const bool tracks_;
  CartesianImpedance motion_;
  std::array<ForceServo, 6> servos_;
};

}  // namespace realtime
