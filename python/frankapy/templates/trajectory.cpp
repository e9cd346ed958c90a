#include "$name.pb.h"
#include "server/part.hpp"

namespace {

using namespace realtime;

// One joint nods: q(t) = q(0) + 64 angle p^3 with p = u (1 - u), u = t / duration. It begins and ends at rest, velocity and
// acceleration included.
class $Name : public TrajectoryGenerator {
 public:
  // In the server room: it may allocate, and throws std::invalid_argument for what the message's rules cannot say.
  $Name(const $name::$Name& message, const Arm&)
      : joint_(static_cast<int>(message.joint()) - 1), angle_(message.angle()), duration_(message.duration()) {}

  Channels fills() const noexcept override { return Channels::kJoint; }

  // From here on in the 1 kHz loop. What is too fast for the arm, the server holds back.
  void start(const Reference& from) noexcept override { goal_ = at_rest(from); }
  bool step(const Cycle&, double time, Reference& reference) noexcept override {
    reference = goal_;
    if (time >= duration_) return true;
    const double u = time / duration_, p = u * (1 - u), dp = 1 - 2 * u;
    reference.joint.q[joint_] += 64 * angle_ * p * p * p;
    reference.joint.dq[joint_] = 192 * angle_ * p * p * dp / duration_;
    reference.joint.ddq[joint_] = 384 * angle_ * (p * dp * dp - p * p) / (duration_ * duration_);
    return false;
  }

  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return duration_; }
  double stretch() const noexcept override { return 1; }

 private:
  int joint_;
  double angle_, duration_;  // rad, s
  Reference goal_;
};

}  // namespace

FRANKA_INTERFACE_PARTS(parts) { parts.add<$Name, $name::$Name>(); }
