#pragma once

#include "realtime/trajectories/min_jerk_pose.hpp"

namespace realtime {

// As MinJerkPose, to the pose of the reference at the start changed by a difference.
class RelativeMinJerkPose : public MinJerkPose {
 public:
  enum class Frame {
    kEndEffector,  // goal = start * difference
    kBase,         // the translation along the axes of O, the rotation still on the right
  };
  struct Parameters {
    Vector3 translation;          // m
    Eigen::Quaterniond rotation;  // in the axes of EE
    Frame frame;                  // of the translation
    double duration;              // s, > 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  RelativeMinJerkPose(const Parameters& parameters, const models::Limits& limits);

  void start(const Reference& from) noexcept override;

 private:
  Vector3 translation_by_;
  Eigen::Quaterniond rotation_by_;
  Frame frame_;
};

}  // namespace realtime
