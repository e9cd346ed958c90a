#include "realtime/terminations/final_joint.hpp"

#include "models/arm.hpp"
#include "realtime/check.hpp"

namespace realtime {

FinalJoint::FinalJoint(const Parameters& parameters) : threshold_(parameters.threshold), judged_(parameters.judged) {
  for (int i = 0; i < models::kJoints; ++i) require_within("threshold", i, threshold_[i], 0, 6.3, "rad");
}

bool FinalJoint::step(const Cycle& cycle, const Progress& progress) noexcept {
  const Vector7& q = judged_ == Judged::kArm ? cycle.q : progress.reference.joint.q;
  const Vector7 way = progress.trajectory.goal().joint.q - q;
  return (way.cwiseAbs().array() <= threshold_.array()).all();
}

}  // namespace realtime
