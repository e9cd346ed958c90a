#pragma once

#include <memory>

#include "models/arm.hpp"
#include "realtime/reference.hpp"

namespace realtime {

// Keeps the reference inside the limits of the arm, whatever is asked for. The robot judges a reference
// by backward differences over its cycle of 1 ms: position (joints: with FR3's velocity envelope),
// velocity, acceleration, jerk; for poses the norms of translation and rotation. So does this.
//
// A reference that obeys is passed on unchanged. Any other is followed with a time-optimal, jerk-limited
// motion (Ruckig) until it can be passed on again; and every output leaves room to brake inside the
// limits from there. Free of allocation after construction; one call for each cycle of the robot.
class Limiter {
 public:
  explicit Limiter(const models::Limits& limits);
  ~Limiter();

  // Continues from here: what the robot has as its last command. Kind, position, velocity and
  // acceleration count. To be called before all else, and whenever the reference jumps on purpose
  // (another kind, re-based by a controller, lost to an error).
  void reset(const Reference& from) noexcept;

  // Next output for what is wanted in this cycle; dt in s. True if it had to hold something back.
  // A reference that is not finite, or of another kind than the one continued from, is braked for.
  bool follow(const Reference& wanted, double dt, Reference& out) noexcept;

  // Next output on the way to rest, in the shortest time; true when at rest.
  bool brake(double dt, Reference& out) noexcept;

  // The cycle went without a command: the robot extrapolates with constant acceleration, and so does
  // this; `out` is where the robot now is.
  void coast(double dt, Reference& out) noexcept;

  // The last output moves no more.
  bool at_rest() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Keeps a torque inside the arm's limits of torque and torque rate.
class TorqueLimiter {
 public:
  explicit TorqueLimiter(const models::Limits& limits);

  // `last` is what was commanded dt seconds before, N m. True if it had to hold something back. An
  // element that is not finite is replaced by the last one, brought towards zero.
  bool limit(const Vector7& wanted, const Vector7& last, double dt, Vector7& out) noexcept;

 private:
  Vector7 tau_max_, dtau_max_;
};

}  // namespace realtime
