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

  // Wherever they were: from here on nothing is left behind.
  void place(const Vector7& q) noexcept;

  // From now on they are to come near this posture, rad; none: the elbow stays.
  void prefer(const std::optional<Vector7>& posture) noexcept { posture_ = posture; }
  bool prefers() const noexcept { return posture_.has_value(); }

  // One step towards the pose, in dt seconds of the elbow's time. Damped next to singularities, where the pose is then not met.
  void step(const CartesianReference& pose, double dt) noexcept;
  // The same, cycle by cycle, of poses that may be out of reach: slower where much is left to them, and not past a singular posture
  // for a pose that is not met there, from where they could come back another way.
  void follow(const CartesianReference& pose, double dt) noexcept;
  // Takes back by what the last step has moved the elbow.
  void leave_elbow() noexcept;

  // What the last follow() found left to the pose of the one before: m and a rotation vector (rad), axes of O. Next to nothing,
  // unless no joints reach it.
  const Vector6& left() const noexcept { return left_; }

  // Where they are, and how they go on from there.
  const JointsOfPose& joints() const noexcept { return joints_; }

 private:
  Vector7 elbow_step(double dt) const noexcept;
  bool nearer_singularity(const Vector7& step) noexcept;
  Vector7 before_singularity(const Vector7& step, const CartesianReference& pose, double way) noexcept;

  Model& model_;
  const models::Limits limits_;
  std::optional<Vector7> posture_;
  JointsOfPose joints_;
  Vector7 elbow_ = Vector7::Zero();         // rad, of the last step
  std::optional<CartesianReference> pose_;  // of the last follow()
  Vector6 left_ = Vector6::Zero();
};

}  // namespace realtime
