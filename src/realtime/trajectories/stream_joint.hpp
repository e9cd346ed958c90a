#pragma once

#include <memory>
#include <optional>
#include <string>

#include "models/arm.hpp"
#include "realtime/trajectories/stream.hpp"

namespace realtime {

template <int N>
class TargetStream;

// Joint positions that come over a topic while the skill runs, made into a smooth motion (TargetStream). It stays where it is
// until the first comes, and ends by a termination only.
class StreamJoint : public Stream {
 public:
  struct Parameters {
    std::string topic;
    std::optional<double> delay;    // s, 0 to 1; 0: each target at once; none: twice the time between targets
    std::optional<double> timeout;  // s without a target after which the arm brakes; 0: it goes on to the last; none: 0.5 s of a
                                    // target at once, 0 of others
    double speed;                   // share of the arm's limits, 0.01 to 1
  };

  // Throws std::invalid_argument naming field, value and bound.
  StreamJoint(const Parameters& parameters, const models::Limits& limits);
  ~StreamJoint() override;

  Channels fills() const noexcept override { return Channels::kJoint; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  bool limited() const noexcept override;

 private:
  std::unique_ptr<TargetStream<models::kJoints>> stream_;
};

}  // namespace realtime
