#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>

#include "realtime/check.hpp"
#include "realtime/ruckig_planner.hpp"
#include "realtime/trajectories/min_jerk.hpp"

namespace realtime {

// Velocities of N coordinates that come at any moment, each reached as fast as the rates allow and kept until the next; after a
// time without one it is brought to zero.
template <int N>
class VelocityStream {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;

  struct Point {
    Vector x = Vector::Zero(), v = Vector::Zero(), a = Vector::Zero();
  };

  // Timeout in s, 0.001 to 3600. Throws std::invalid_argument naming field, value and bound.
  VelocityStream(double timeout, const std::array<models::Limits::Rates, N>& rates) : timeout_(timeout), rates_(rates) {
    require_within("timeout", -1, timeout, 0.001, 3600, "s");
    planner_.in.control_interface = ruckig::ControlInterface::Velocity;
    planner_.in.synchronization = ruckig::Synchronization::None;
    for (int i = 0; i < N; ++i) {
      planner_.in.max_velocity[i] = rates[i].velocity;
      planner_.in.max_acceleration[i] = rates[i].acceleration;
      planner_.in.max_jerk[i] = rates[i].jerk;
    }
  }

  // From here, at time 0.
  void start(const Point& from) {
    out_ = from;
    time_ = 0;
    planned_ = false;
    wish(Vector::Zero());
  }

  // Came at the time of the last point.
  void add(const Vector& v) {
    heard_ = clock_;
    wish(v);
  }

  // `clock`: s of the robot's time, by which the timeout counts, while `time` may go slower. Neither decreases.
  const Point& at(double time, double clock) {
    clock_ = clock;
    if (moves_ && clock - heard_ > timeout_) wish(Vector::Zero());
    time_ = time;
    if (!planned_) return out_;
    std::array<double, N> x, v, a;
    planner_.trajectory.at_time(std::max(time - plan_start_, 0.0), x, v, a);
    out_ = {Vector::Map(x.data()) + shift_, Vector::Map(v.data()), Vector::Map(a.data())};
    return out_;
  }

  // The last point.
  const Point& point() const { return out_; }

  // Of what is held back no more is ahead than it makes in so long.
  static constexpr double kAhead = 0.1;  // s

  // Whether the newest velocity is beyond the rates.
  bool limited() const { return limited_; }

  // Goes on from another place with the same motion.
  void move_to(const Vector& x) {
    shift_ += x - out_.x;
    out_.x = x;
  }

 private:
  void wish(const Vector& v) {
    limited_ = false;
    for (int i = 0; i < N; ++i) {
      planner_.in.target_velocity[i] = std::clamp(v[i], -rates_[i].velocity, rates_[i].velocity);
      planner_.in.target_acceleration[i] = 0;
      limited_ |= planner_.in.target_velocity[i] != v[i];
    }
    moves_ = !v.isZero(0);
    if (planned_ && v == wish_) return;
    wish_ = v;
    plan();
  }

  void plan() {
    for (int i = 0; i < N; ++i) {
      planner_.in.current_position[i] = out_.x[i];
      planner_.in.current_velocity[i] = out_.v[i];
      planner_.in.current_acceleration[i] = out_.a[i];
    }
    plan_start_ = time_;
    shift_.setZero();
    planned_ = planner_.plan();
  }

  double timeout_;
  std::array<models::Limits::Rates, N> rates_;
  RuckigPlanner<N> planner_;
  Point out_;
  Vector wish_ = Vector::Zero();
  Vector shift_ = Vector::Zero();  // of what is planned
  double time_ = 0, plan_start_ = 0;  // s
  double clock_ = 0, heard_ = 0;      // s of the robot's time: of the last point, and of the last velocity
  bool moves_ = false, planned_ = false, limited_ = false;
};

}  // namespace realtime
