#include "realtime/trajectories/pose_difference.hpp"

#include <string>

#include "realtime/check.hpp"

namespace realtime {

Eigen::Quaterniond require_rotation(const char* field, const Eigen::Quaterniond& q) {
  require_within(std::string("norm of ") + field, -1, q.norm(), 0.999, 1.001, "");
  return q.normalized();
}

PoseDifference::PoseDifference(const Vector3& translation, const Eigen::Quaterniond& rotation, Frame frame)
    : translation_(translation), rotation_(require_rotation("quaternion", rotation)), frame_(frame) {
  for (int i = 0; i < 3; ++i) require_within("translation", i, translation_[i], -2, 2, "m");
}

void PoseDifference::apply(const CartesianReference& start, CartesianReference& goal) const noexcept {
  const Vector3 by = frame_ == Frame::kEndEffector ? Vector3(start.orientation * translation_) : translation_;
  goal.position = start.position + by;
  goal.orientation = (start.orientation * rotation_).normalized();
}

}  // namespace realtime
