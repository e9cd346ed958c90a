#pragma once

#include <optional>

#include "models/arm.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// One velocity for a while, from rest to rest, in time T. It is reached, and left likewise, with an acceleration that rises for
// r, stays, and falls for r: c + r after the beginning, where
//   c = max(|v_i| / a_i, sqrt(|v_i| / j_i)),  r = max(|v_i| / j_i) / c <= c
// so that no axis has more than acceleration a_i and jerk j_i. T is lengthened to 2 (c + r) where it is shorter.
class Trapezoid {
 public:
  // All s.
  Trapezoid(double duration, double c, double r);

  double duration() const { return duration_; }
  // Values of the integral of v/v_max, of v/v_max and of its derivative (1/s) at t (s).
  struct Point {
    double way, rate, acceleration;
  };
  Point at(double t) const;

 private:
  Point begin(double t) const;  // t at most c + r

  double c_, r_, duration_;
};

// Joints with constant velocities.
class JointVelocity : public TrajectoryGenerator {
 public:
  struct Parameters {
    Vector7 dq;                  // rad/s
    std::optional<Vector7> ddq;  // rad/s², > 0; none: half of the arm's limits
    double duration;             // s, > 0
  };

  // Throws std::invalid_argument naming field, value and bound.
  JointVelocity(const Parameters& parameters, const models::Limits& limits);

  Channels fills() const noexcept override { return Channels::kJoint; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  bool shortened() const noexcept override { return shortened_; }
  double duration() const noexcept override { return profile_.duration(); }
  double stretch() const noexcept override { return profile_.duration() / asked_duration_; }

 private:
  models::Limits limits_;
  Vector7 dq_;
  double asked_duration_;
  Trapezoid profile_;
  Vector7 from_ = Vector7::Zero();
  Reference goal_;
  bool shortened_ = false;
};

// EE with a constant twist in the axes of O: along a line, and turning about an axis.
class CartesianVelocity : public TrajectoryGenerator {
 public:
  struct Parameters {
    Vector6 O_dP_EE;                  // m/s, rad/s
    std::optional<Vector6> O_ddP_EE;  // m/s², rad/s², > 0; none: half of the arm's limits, and of its joints'
    double duration;                  // s, > 0
  };

  // `dq`: of the joints with that twist, where it begins, rad/s. Throws std::invalid_argument naming field, value and bound.
  CartesianVelocity(const Parameters& parameters, const models::Limits& limits, const Vector7& dq);

  Channels fills() const noexcept override { return Channels::kPose; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return profile_.duration(); }
  double stretch() const noexcept override { return profile_.duration() / asked_duration_; }

 private:
  Vector6 twist_;
  double asked_duration_;
  Trapezoid profile_;
  CartesianReference from_;
  Reference goal_;
};

}  // namespace realtime
