#include "$name.pb.h"
#include "server/part.hpp"

namespace {

using namespace realtime;

// A spring and a damper in each joint: tau_J_d = K (q_ref - q) + D (dq_ref - dq) + coriolis.
class $Name : public Controller {
 public:
  // In the server room: it may allocate, and throws std::invalid_argument for what the message's rules cannot say.
  $Name(const $name::$Name& message, const Arm& arm) : K_(server::vector<7>(message.stiffness())) {
    // D for each joint's inertia in the posture in which the skill begins.
    D_ = 2 * message.damping_ratio() * K_.cwiseProduct(arm.model.mass().diagonal()).cwiseSqrt();
  }

  Channels takes() const noexcept override { return Channels::kJoint; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }

  // From here on in the 1 kHz loop. Where the torque would step at the start, the server lets the difference fade away.
  void start(const Cycle&, Reference&) noexcept override {}
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override {
    tau_J_d = K_.cwiseProduct(reference.joint.q - cycle.q) + D_.cwiseProduct(reference.joint.dq - cycle.dq) +
              cycle.model.coriolis();
  }

 private:
  Vector7 K_, D_;  // N m/rad, N m s/rad
};

}  // namespace

FRANKA_INTERFACE_PARTS(parts) { parts.add<$Name, $name::$Name>(); }
