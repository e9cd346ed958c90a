#pragma once

#include "realtime/trajectories/joint_path.hpp"
#include "realtime/trajectories/samples.hpp"

namespace realtime {

// Joint positions for each ms, 3 to 120 000 of them (2 minutes): exact in the cycles, from an arm that is within 0.1
// rad of the first one; that difference fades away as with JointPath while they run. As a whole they are stretched
// where their velocity and acceleration, in steps of 10 ms, break the limits; what is left, noise and an end that does
// not rest, is for the limiter.
class JointSamples : public JointPath {
 public:
  // rad, one column for each; `from`: where the arm is, rad. Throws std::invalid_argument naming field, value and
  // bound, and what to do where the arm is elsewhere.
  JointSamples(const Samples<7>::Table& q, const models::Limits& limits, const Vector7& from);

 private:
  JointReference at(double t) const noexcept override;

  Samples<7> samples_;
};

}  // namespace realtime
