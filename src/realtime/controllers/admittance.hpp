#pragma once

#include "realtime/controllers/cartesian_impedance.hpp"

namespace realtime {

// EE moves as a mass with a damper (and a spring to the reference, if it has stiffness) would under the force that the
// surroundings exert on it:
//   m ddx + d dx + k x = -felt
// x is the way from the reference along, and the rotation about, the axes of O; felt is what the robot estimates that EE
// exerts, at EE. CartesianImpedance, stiff, follows the reference and x with velocity and acceleration (admittance or position-based
// impedance control: Hogan, Impedance control, J. Dynamic Systems, Measurement, and Control 107(1), 1985; Ott, Mukherjee,
// Nakamura, Unified impedance and admittance control, ICRA 2010). The estimate is some 10 ms old, so a light mass against a
// stiff surface swings: choose d great enough there.
// x is at most 5 cm and 0.2 rad ahead of where the arm has followed: it does not run into what keeps the arm.
class Admittance : public Controller {
 public:
  struct Parameters {
    Vector6 mass;                   // kg, 0.5 to 100; kg m², 0.01 to 10
    Vector6 damping;                // N s/m, 0 to 2000; N m s/rad, 0 to 200
    Vector6 stiffness;              // N/m, 0 to 3000; N m/rad, 0 to 300
    double translational_tracking;  // N/m, 100 to 3000: stiffness of what follows
    double rotational_tracking;     // N m/rad, 10 to 300
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit Admittance(const Parameters& parameters);

  Channels takes() const noexcept override { return Channels::kPose; }
  // Without a spring on an axis, the arm stays where it was led.
  bool tracks() const noexcept override { return parameters_.stiffness.minCoeff() > 0; }
  bool leads() const noexcept override { return false; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }

  // Moves the reference as CartesianImpedance does, with x = 0.
  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void stay() noexcept override;
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

 private:
  void stay_near(const Vector3& position, const Eigen::Quaterniond& orientation) noexcept;

  Parameters parameters_;
  CartesianImpedance follower_;
  Vector3 position_ = Vector3::Zero();  // x
  Eigen::Quaterniond orientation_ = Eigen::Quaterniond::Identity();
  Vector6 velocity_ = Vector6::Zero();
};

}  // namespace realtime
