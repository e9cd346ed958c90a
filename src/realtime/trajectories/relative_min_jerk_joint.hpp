#pragma once

#include "realtime/trajectories/min_jerk_joint.hpp"

namespace realtime {

// As MinJerkJoint, to the reference at the start plus a difference. A goal beyond a joint's range is
// moved to the end of that range (at construction the start is not known).
class RelativeMinJerkJoint : public MinJerkJoint {
 public:
  struct Parameters {
    Vector7 delta_q;  // rad
    double duration;  // s, > 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  RelativeMinJerkJoint(const Parameters& parameters, const models::Limits& limits);

  void start(const Reference& from) noexcept override;
  bool shortened() const noexcept override { return shortened_; }

 private:
  Vector7 delta_q_;
  bool shortened_ = false;
};

}  // namespace realtime
