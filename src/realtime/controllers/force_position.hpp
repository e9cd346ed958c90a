#pragma once

#include <array>
#include <optional>
#include <string>

#include "realtime/controllers/controller.hpp"
#include "realtime/controllers/force_servo.hpp"
#include "realtime/controllers/gain_stream.hpp"

namespace realtime {

// The hybrid law of frankapy: each axis of O is controlled in position, in force, or in parts in both. S is 1 for position,
// felt the estimate of what EE exerts, wrench the trajectory's. With gains of EE
//   tau_J_d = J^T (S (K e + D (v_ref - v)) + (1 - S) F) + coriolis
// with D = 2 sqrt(K), or less where the delay of the loop does not allow it.
// F is a ForceServo with the force gains, and 10 1/s of them for the integral. With gains of the joints
//   tau_J_d = K_q J^+ S e + 2 sqrt(K_q) (J^+ S v_ref - dq) + J^T (1 - S) F + k_f J^T (1 - S) (wrench - felt) + coriolis
// F is without its proportional part then, and what is missing of the wrench no more than ForceServo allows in free space.
// J^+ is the damped pseudo-inverse. With gains of EE, joint motions that leave EE at rest are damped by 5 N m s/rad. A topic gives
// gains and S anew while it runs (ForcePositionControllerSensorMessage).
class ForcePosition : public Controller {
 public:
  struct Parameters {
    Vector6 selection;           // S, 0 to 1
    bool use_cartesian_gains;
    Vector6 position_kps_cart;   // K, 0 to 3000 N/m, 0 to 300 N m/rad
    Vector6 force_kps_cart;      // 0 to 2
    Vector7 position_kps_joint;  // K_q, N m/rad, 0 to 3000
    Vector7 force_kps_joint;     // k_f, 0 to 2
    double max_speed;            // m/s, 0.001 to 0.2, along axes of force in free space; 5 times as many rad/s about them
    std::optional<std::string> topic = {};
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit ForcePosition(const Parameters& parameters);
  // With the mass matrix where the arm begins: joint gains that no loop of 1 ms could hold are refused as well
  // (require_holdable()), whether they are used from the beginning or sent; what it could not hold where the arm is later is softened.
  ForcePosition(const Parameters& parameters, const Matrix7& mass);

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return gains_.inputs(); }
  Channels takes() const noexcept override { return Channels::kPose | Channels::kWrench; }
  bool tracks() const noexcept override { return !gains_.changes() && all_position(); }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }
  Vector6 led_pose(const Cycle&, const Vector6& way) const noexcept override;

  // Moves the reference pose along axes of position.
  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

 private:
  ForcePosition(const Parameters& parameters, const GainStream<32>::Check& check);
  bool all_position() const noexcept;

  GainStream<32> gains_;  // in the order of the message
  bool use_cartesian_gains_;
  double max_speed_;
  std::array<ForceServo, 6> servos_;
};

}  // namespace realtime
