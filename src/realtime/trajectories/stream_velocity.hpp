#pragma once

#include <memory>
#include <optional>
#include <string>

#include "models/arm.hpp"
#include "realtime/trajectories/stream.hpp"

namespace realtime {

template <int N>
class VelocityStream;

// Joint velocities that come over a topic while the skill runs. It ends by a termination only.
class StreamJointVelocity : public Stream {
 public:
  struct Parameters {
    std::string topic;
    double timeout;  // s without a velocity after which the arm stops, 0.001 to 3600
    double speed;    // share of the arm's limits, 0.01 to 1
  };

  // Throws std::invalid_argument naming field, value and bound.
  StreamJointVelocity(const Parameters& parameters, const models::Limits& limits);
  ~StreamJointVelocity() override;

  Channels fills() const noexcept override { return Channels::kJoint; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  void held_back(const Reference& reference) noexcept override;
  bool limited() const noexcept override;

 private:
  std::unique_ptr<VelocityStream<models::kJoints>> stream_;
  Vector7 rest_min_, rest_max_, q_min_, q_max_;  // rad
  bool at_end_ = false;    // of a joint's range
};

// The same of EE, along and about the axes of O.
class StreamCartesianVelocity : public Stream {
 public:
  using Parameters = StreamJointVelocity::Parameters;

  // Throws std::invalid_argument naming field, value and bound.
  StreamCartesianVelocity(const Parameters& parameters, const models::Limits& limits);
  ~StreamCartesianVelocity() override;

  Channels fills() const noexcept override { return Channels::kPose; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  void held_back(const Reference& reference) noexcept override;
  bool limited() const noexcept override;

 private:
  std::unique_ptr<VelocityStream<6>> stream_;
  double time_ = 0;                        // s, of the last step
  Eigen::Quaterniond orientation_{1, 0, 0, 0};
};

}  // namespace realtime
