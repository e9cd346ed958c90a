#pragma once

#include "realtime/reference.hpp"

namespace realtime {

// What a relative trajectory changes the pose at its start by.
class PoseDifference {
 public:
  enum class Frame {
    kEndEffector,  // goal = start * difference
    kBase,         // the translation along the axes of O, the rotation still on the right
  };

  // Translation in m, in the axes of `frame`; rotation in the axes of EE. Throws std::invalid_argument naming field,
  // value and bound.
  PoseDifference(const Vector3& translation, const Eigen::Quaterniond& rotation, Frame frame);

  // Position and orientation of `goal`.
  void apply(const CartesianReference& start, CartesianReference& goal) const noexcept;

 private:
  Vector3 translation_;
  Eigen::Quaterniond rotation_;
  Frame frame_;
};

// The quaternion of that field with norm 1; throws std::invalid_argument if it is not one.
Eigen::Quaterniond require_rotation(const char* field, const Eigen::Quaterniond& q);

}  // namespace realtime
