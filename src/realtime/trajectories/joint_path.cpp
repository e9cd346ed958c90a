#include "realtime/trajectories/joint_path.hpp"

#include <algorithm>

namespace realtime {

void JointPath::start(const Reference& from) noexcept {
  const JointReference path = at(0);
  const Vector7 dq = from.joint.dq - path.dq, ddq = from.joint.ddq - path.ddq;
  double decay = 0;
  for (int i = 0; i < models::kJoints; ++i) {
    decay = std::max(decay, decay_duration(std::abs(dq[i]), std::abs(ddq[i]), rates(limits_, i)));
  }
  fading_.start(from.joint.q - path.q, dq, ddq, Vector7::Zero(), decay);
  double T = decay;
  for (int i = 0; i < models::kJoints; ++i)
    T = std::max(T, fade_duration(std::abs(fading_.way()[i]), rates(limits_, i)));
  fading_.set_duration(T);
  wait_ = std::max(0.0, T - clear_after_);
}

bool JointPath::step(const Cycle&, double time, Reference& reference) noexcept {
  if (time >= duration()) {
    reference = goal_;
    return true;
  }
  reference.motion = Channels::kJoint;
  reference.joint = at(std::clamp(time - wait_, 0.0, length_));
  if (time < wait_ || time > wait_ + length_) {
    reference.joint.dq.setZero();
    reference.joint.ddq.setZero();
  }
  const auto rest = fading_.at(time);
  reference.joint.q += rest.x;
  reference.joint.dq += rest.v;
  reference.joint.ddq += rest.a;
  return false;
}

void raise_by_joints(const models::Limits& limits, double share, const Vector7& q, const Vector7& dq,
                     const Vector7& ddq, const Vector7& dddq, double& worst) noexcept {
  constexpr double kEnvelopeRoom = 0.025;  // rad/s that the limiter wants for braking under the envelope
  constexpr double kSlowest = 1e-3;        // rad/s
  for (int i = 0; i < models::kJoints; ++i) {
    double v_max = limits.dq_max[i];
    if (limits.envelope_deceleration[i] != 0) {
      v_max = dq[i] > 0 ? limits.dq_upper(i, q[i]) : -limits.dq_lower(i, q[i]);
      v_max = v_max > kEnvelopeRoom + kSlowest ? v_max - kEnvelopeRoom : kSlowest;  // not a number beyond its end
    }
    raise(worst, std::abs(dq[i]) / (share * v_max), std::abs(ddq[i]) / (share * limits.ddq_max[i]),
          std::abs(dddq[i]) / (share * limits.dddq_max[i]));
  }
}

}  // namespace realtime
