#pragma once

#include <optional>

#include "models/arm.hpp"
#include "realtime/model.hpp"

namespace realtime {

// The joints with which an arm follows a pose, where they are ours to choose: differential inverse kinematics, closed over the
// forward kinematics so that nothing drifts. The elbow (joint 3) stays where it is, or goes to where the joints are nearest to a
// posture; it gives way where a joint comes near to the end of its range.
class PoseJoints {
 public:
  PoseJoints(Model& model, const models::Limits& limits) : model_(model), limits_(limits) {}

  void place(const Vector7& q) noexcept { joints_.q = q; }

  // From now on they are to come near this posture, rad; none: the elbow stays.
  void prefer(const std::optional<Vector7>& posture) noexcept { posture_ = posture; }
  bool prefers() const noexcept { return posture_.has_value(); }

  // One step towards the pose, in dt seconds of the elbow's time. Damped next to singularities, where the pose is then not met.
  void step(const CartesianReference& pose, double dt) noexcept;

  // Where they are, with the map that led there.
  const JointsOfPose& joints() const noexcept { return joints_; }

 private:
  double elbow_speed() const noexcept;

  Model& model_;
  const models::Limits limits_;
  std::optional<Vector7> posture_;
  JointsOfPose joints_;
};

}  // namespace realtime
