#pragma once

#include <optional>
#include <string>

#include "realtime/controllers/controller.hpp"
#include "realtime/controllers/gain_stream.hpp"

namespace realtime {

// Gives some joints a torque, and holds the others where they are when it takes over. For each joint
//   tau_J_d = s (torque + torque of the trajectory) + (1 - s) (K (q_start - q) - D dq) + coriolis - r gravity(q)
// s is 1 for a torque and 0 for holding, r is 1 to let the joint feel gravity, which the robot compensates otherwise; parts
// of them are possible. Gravity is of the arm with its tool, along the O_ddP_O that the robot reports. A topic gives all of them
// anew while it runs (JointTorqueControllerSensorMessage): torque at once, the rest as GainStream. Where it has been silent for a
// given time, the torque gives way to -D dq within 0.1 s, until the next message.
class PassThroughJointTorque : public Controller {
 public:
  struct Parameters {
    Vector7 torque;          // N m, -100 to 100
    Vector7 selection;       // s, 0 to 1
    Vector7 remove_gravity;  // r, 0 to 1
    Vector7 stiffness;       // K, N m/rad, 0 to 3000
    Vector7 damping;         // D, N m s/rad, 0 to 200
    std::optional<std::string> topic = {};
    double timeout = 0;  // s, 0 to 3600; 0: never
  };

  // Throws std::invalid_argument naming field, value and bound. `mass`: of the links where the arm begins; springs that no
  // loop of 1 ms could hold are refused, and those that it could not hold where the arm is led are softened (keep_holdable()).
  PassThroughJointTorque(const Parameters& parameters, const Matrix7& mass);

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return gains_.inputs(); }
  Channels takes() const noexcept override { return Channels::kJoint | Channels::kPose | Channels::kTorque; }
  bool tracks() const noexcept override { return false; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }

  // q_start is where the springs of the joints that are held ask for the torque that is there.
  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

 private:
  Vector7 law(const Cycle& cycle, const Reference& reference) const noexcept;

  GainStream<35> gains_;  // in the order of the message
  double timeout_;        // s
  double given_ = 1;      // share of the torque that is given
  Vector7 q_start_ = Vector7::Zero();
};

}  // namespace realtime
