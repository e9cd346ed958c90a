#pragma once

#include <memory>
#include <optional>
#include <string>

#include "models/arm.hpp"
#include "realtime/trajectories/stream.hpp"

namespace realtime {

template <int N>
class TargetStream;

// As StreamJoint, poses of EE in O. Orientations are passed as rotation vectors relative to the orientation at the start.
class StreamPose : public Stream {
 public:
  struct Parameters {
    std::string topic;
    std::optional<double> delay;    // s, 0 to 1; 0: each target at once; none: twice the time between targets
    std::optional<double> timeout;  // s without a target after which the arm brakes; 0: it goes on to the last; none: 0.5 s of a
                                    // target at once, 0 of others
    double speed;                   // share of the arm's limits, 0.01 to 1
  };

  // Throws std::invalid_argument naming field, value and bound.
  StreamPose(const Parameters& parameters, const models::Limits& limits);
  ~StreamPose() override;

  Channels fills() const noexcept override { return Channels::kPose; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  bool limited() const noexcept override;

 protected:
  StreamPose(const Parameters& parameters, const models::Limits& limits, std::shared_ptr<SensorInput> input);
  // Takes a message that came `time` s after the start.
  virtual void take(double time, const SensorSample& sample) noexcept;
  void add(double time, const SensorSample& sample, const Vector3& position, const Eigen::Quaterniond& orientation) noexcept;

 private:
  std::unique_ptr<TargetStream<6>> stream_;
  Vector3 turn_ = Vector3::Zero();  // of the last target, relative to the start
};

}  // namespace realtime
