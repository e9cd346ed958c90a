#pragma once

#include "realtime/trajectories/stream_pose.hpp"

namespace realtime {

// As StreamPose, with the wrench that EE is to exert: it goes from where it is to what was sent last in a straight line, for
// 0.05 s, and stays until nothing has come for the timeout (none given: 0.5 s; 0: for good). Then it goes to zero likewise.
class StreamForcePosition : public StreamPose {
 public:
  // Throws std::invalid_argument naming field, value and bound.
  StreamForcePosition(const Parameters& parameters, const models::Limits& limits);

  Channels fills() const noexcept override { return Channels::kPose | Channels::kWrench; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;

 private:
  void take(double time, const SensorSample& sample) noexcept override;

  double timeout_;                                               // s
  std::optional<double> heard_;  // s of the robot's time, when the last message came, or the start; none: since the last step
  double last_ = 0;                                              // s, time of the last step
  Vector6 wrench_ = Vector6::Zero(), wanted_ = Vector6::Zero();  // N, N m
  double reached_ = 0;                                           // s, when wrench_ is wanted_
};

}  // namespace realtime
