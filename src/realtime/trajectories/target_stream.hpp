#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "models/arm.hpp"
#include "realtime/check.hpp"
#include "realtime/ruckig_planner.hpp"

namespace realtime {

// A smooth motion of N coordinates along targets that come at any moment, early, late or not at all.
//
// With delay 0 each target is gone to at once, time-optimally inside the rates. With a delay the targets are knots of a cubic
// Hermite spline that is passed so long after they were meant, with slopes from their neighbours (Catmull-Rom); a slope stays
// as it is once the segment before it is begun, so that position and velocity are continuous. Until the first target the motion
// brakes; where targets run out it brakes, and then comes back to the last; one that comes when its time has passed begins the
// delay anew; where targets jump, come back, or come in a heap, the difference fades as fast as the rates allow, however often
// that begins again. Without a given delay it is twice the time between targets, as observed.
template <int N>
class TargetStream {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;

  struct Point {
    Vector x = Vector::Zero(), v = Vector::Zero(), a = Vector::Zero();
  };
  struct Target {
    Vector x;
    double sent;    // s by the clock of its publisher; NaN: unknown
    double lead;    // s after that at which it is meant
    bool replaces;  // those that are meant for later
  };

  // Delay (0 to 1) and timeout in s; after `timeout` without a target (0: never) the motion brakes where it is, whatever
  // targets are left. None given: kTimeout on the way to one that is gone to at once, else 0. `rates`: of each coordinate.
  // Throws std::invalid_argument naming field, value and bound.
  TargetStream(std::optional<double> delay, std::optional<double> timeout, const std::array<models::Limits::Rates, N>& rates)
      : given_delay_(delay), timeout_(timeout), rates_(rates) {
    if (delay) require_within("delay", -1, *delay, 0, 1, "s");
    if (timeout) require_within("timeout", -1, *timeout, 0, 3600, "s");
    for (int i = 0; i < N; ++i) {
      planner_.in.max_velocity[i] = rates[i].velocity;
      planner_.in.max_acceleration[i] = rates[i].acceleration;
      planner_.in.max_jerk[i] = rates[i].jerk;
      fade_.in.max_velocity[i] = kFadeShare * rates[i].velocity;
      fade_.in.max_acceleration[i] = kFadeShare * rates[i].acceleration;
      fade_.in.max_jerk[i] = rates[i].jerk;
      fade_.in.target_position[i] = fade_.in.target_velocity[i] = fade_.in.target_acceleration[i] = 0;
    }
  }

  // From here, at time 0.
  void start(const Point& from) {
    out_ = from;
    desired_ = from;
    time_ = 0;
    plan_start_ = 0;
    heard_.reset();
    first_ = count_ = 0;
    fade_end_ = -1;
    ran_out_ = limited_ = false;
    wished_.reset();
    clock_ = kNever;
    period_ = 0;
    delay_ = given_delay_.value_or(kMostDelay);
    buffered_ = !given_delay_ || *given_delay_ > 0;
    brake();
  }

  // Came at `time`, s since start(); below 0: while the start was waited for.
  void add(double time, const Target& target) {
    heard_.reset();
    buffered_ = buffered_ || target.lead > 0;
    if (!buffered_) {
      wished_ = target.x;  // of many in a cycle the last is planned to
      return;
    }
    double t = time;
    if (std::isfinite(target.sent)) {
      // The least way that a message took: what others took longer is no motion.
      const double clock = time - target.sent;
      clock_ = std::isfinite(clock_) ? std::min(clock, clock_ + kClockDrift * std::max(clock - clock_, 0.0)) : clock;
      t = target.sent + clock_;
      if (target.lead <= 0 && t < time_ - delay_) {
        clock_ = clock;
        t = time;
      }
    }
    observe_period(t, target);
    const double meant = target.sent + target.lead;
    if (target.lead > 0) t += target.lead - delay_;
    if (target.replaces) {
      while (count_ > 0 && knot(count_ - 1).t >= t && !knot(count_ - 1).used) --count_;
    }
    const double p = time_ - delay_;
    if (count_ == 0 && t > p + kLeastStep) knot(count_++) = {p, kNever, desired_.x};
    if (count_ > 0 && t <= knot(count_ - 1).t + kLeastStep) {
      if (Knot& last = knot(count_ - 1); !last.used) {
        last.x = target.x;
        last.meant = meant;
      }
      return;
    }
    if (count_ == kKnots) return;  // not those that are passed next
    knot(count_++) = {t, meant, target.x};
  }

  // `clock`: s of the robot's time, by which the timeout counts, while `time` may go slower. Neither decreases.
  Point at(double time, double clock) {
    if (!heard_) heard_ = clock;
    if (wished_) go_to(*wished_, out_);
    wished_.reset();
    const double dt = time - time_;
    time_ = time;
    const double timeout = timeout_.value_or(buffered_ ? 0 : kTimeout);
    if (timeout > 0 && clock - *heard_ > timeout && (buffered_ ? count_ > 0 : !braked_)) {
      plan_start_ = time - dt;
      desired_ = out_;
      fade_end_ = -1;
      count_ = 0;
      ran_out_ = false;
      brake();
    }
    limited_ = false;
    const Point last = desired_;
    desired_ = buffered_ ? along_knots(time, dt) : planned(time - plan_start_);
    smooth(last, time, dt);
    return out_;
  }

  // Whether targets around the last point are farther apart than the rates allow.
  bool limited() const { return limited_; }

  static constexpr double kTimeout = 0.5;  // s

 private:
  static constexpr int kKnots = 2048;  // the longest delay at 1 kHz, and as much ahead
  static constexpr double kNever = std::numeric_limits<double>::quiet_NaN();
  static constexpr double kClockDrift = 0.02;   // share of a longer way that is taken for a slower clock
  static constexpr double kLeastStep = 2e-4;    // s between knots
  static constexpr double kLongestPeriod = 0.5;  // s; what is longer is a pause
  static constexpr double kLeastDelay = 0.002, kMostDelay = 0.5;  // s
  static constexpr double kFadeShare = 0.7;     // of the rates
  static constexpr double kSoft = 1.5;          // times the acceleration that the spline may have
  static constexpr double kHeap = 0.5;          // of the time meant between targets: less is a heap after a pause

  struct Knot {
    double t;      // s
    double meant;  // s, by the clock of its publisher; NaN: unknown
    Vector x, v = Vector::Zero();
    bool used = false;  // v is final
    bool left = false;  // the motion to the next has begun
  };

  void observe_period(double t, const Target& target) {
    if (target.lead > 0 || given_delay_) return;
    if (count_ > 0) {
      const double step = t - knot(count_ - 1).t;
      if (step > 0 && step < kLongestPeriod) period_ = period_ == 0 ? step : period_ + 0.1 * (step - period_);
    }
    if (period_ == 0) return;
    wanted_delay_ = std::clamp(2 * period_, kLeastDelay, kMostDelay);
    if (delay_ == kMostDelay) delay_ = wanted_delay_;
  }

  void set_current(const Point& point) {
    for (int i = 0; i < N; ++i) {
      planner_.in.current_position[i] = point.x[i];
      planner_.in.current_velocity[i] = point.v[i];
      planner_.in.current_acceleration[i] = point.a[i];
      planner_.in.target_velocity[i] = planner_.in.target_acceleration[i] = 0;
    }
  }

  void go_to(const Vector& x, const Point& from) {
    set_current(from);
    planner_.in.control_interface = ruckig::ControlInterface::Position;
    for (int i = 0; i < N; ++i) planner_.in.target_position[i] = x[i];
    plan_start_ = time_;
    braked_ = false;
    planned_ = planner_.plan();
    end_ = x;
  }

  // From desired_ to rest.
  void brake() {
    set_current(desired_);
    planner_.in.control_interface = ruckig::ControlInterface::Velocity;
    braked_ = true;
    planned_ = planner_.plan();
    end_ = desired_.x;
  }

  Point planned(double t) const {
    Point point;
    if (!planned_) {
      point.x = end_;
      return point;
    }
    std::array<double, N> x, v, a;
    planner_.trajectory.at_time(std::clamp(t, 0.0, planner_.trajectory.get_duration()), x, v, a);
    return {Vector::Map(x.data()), Vector::Map(v.data()), Vector::Map(a.data())};
  }

  Knot& knot(int i) { return knots_[(first_ + i) % kKnots]; }

  void drop_first() {
    first_ = (first_ + 1) % kKnots;
    --count_;
  }

  bool jumps(const Knot& from, const Knot& to) const { return are_heaped(from, to) || is_too_fast(from, to); }

  bool are_heaped(const Knot& from, const Knot& to) const { return to.t - from.t < kHeap * (to.meant - from.meant); }

  bool is_too_fast(const Knot& from, const Knot& to) const {
    for (int i = 0; i < N; ++i) {
      if (std::abs(to.x[i] - from.x[i]) > rates_[i].velocity * (to.t - from.t)) return true;
    }
    return false;
  }

  // Slope at a knot: of the parabola through its neighbours, as far as these are no jump away.
  void fix(int i) {
    Knot& here = knot(i);
    if (here.used) return;
    here.used = true;
    const bool before = i > 0 && !jumps(knot(i - 1), here);
    const bool after = i + 1 < count_ && !jumps(here, knot(i + 1));
    const auto slope = [this](int a, int b) { return Vector((knot(b).x - knot(a).x) / (knot(b).t - knot(a).t)); };
    if (before && after) {
      const double left = here.t - knot(i - 1).t, right = knot(i + 1).t - here.t;
      here.v = (right * slope(i - 1, i) + left * slope(i, i + 1)) / (left + right);
    } else if (before || after) {
      here.v = before ? slope(i - 1, i) : slope(i, i + 1);
    }
  }

  // Where the spline would accelerate too much the motion between two knots is even: what velocity jumps by fades.
  void soften(Knot& from, Knot& to) {
    from.left = true;
    const double T = to.t - from.t;
    const Vector chord = (to.x - from.x) / T;
    for (int i = 0; i < N; ++i) {
      const double most = kSoft * rates_[i].acceleration * T / 2;
      if (std::abs(3 * chord[i] - 2 * from.v[i] - to.v[i]) > most || std::abs(3 * chord[i] - from.v[i] - 2 * to.v[i]) > most) {
        from.v = to.v = chord;
        return;
      }
    }
  }

  Point along_knots(double time, double dt) {
    // A delay that changes makes the motion pass a little faster or slower.
    const double change = given_delay_ || period_ == 0 ? 0 : std::clamp(0.5 * (wanted_delay_ - delay_), -0.02, 0.02);
    delay_ += change * dt;
    const double p = time - delay_, rate = 1 - change;
    while (count_ >= 3 && knot(2).t <= p) drop_first();
    int i = 0;  // the last knot that is passed
    while (i + 1 < count_ && knot(i + 1).t <= p) ++i;
    if (count_ == 0 || p < knot(0).t) {
      const bool at_rest = braked_ && time - plan_start_ > planner_.trajectory.get_duration();
      if (ran_out_ && at_rest) go_to(last_, planned(time - plan_start_));
      return braked_ || ran_out_ ? planned(time - plan_start_) : desired_;
    }
    fix(i);
    if (i + 1 == count_) {  // targets have run out
      desired_ = {knot(i).x, knot(i).v, Vector::Zero()};
      plan_start_ = knot(i).t + delay_;
      brake();
      ran_out_ = true;
      last_ = knot(i).x;
      count_ = 0;
      return planned(time - plan_start_);
    }
    braked_ = ran_out_ = false;
    Knot &from = knot(i), &to = knot(i + 1);
    limited_ = is_too_fast(from, to);
    if (limited_ || are_heaped(from, to)) return {to.x, Vector::Zero(), Vector::Zero()};
    fix(i + 1);
    const double T = to.t - from.t, u = (p - from.t) / T;
    if (!from.left) soften(from, to);
    Point point;
    point.x = from.x + u * u * (3 - 2 * u) * (to.x - from.x) + T * u * ((1 - u) * (1 - u) * from.v - u * (1 - u) * to.v);
    point.v = rate * (6 * u * (1 - u) / T * (to.x - from.x) + (1 + u * (3 * u - 4)) * from.v + u * (3 * u - 2) * to.v);
    point.a = rate * rate * ((6 - 12 * u) / (T * T) * (to.x - from.x) + (6 * u - 4) / T * from.v + (6 * u - 2) / T * to.v);
    return point;
  }

  // Adds to desired_ what is left of its last jump.
  void smooth(const Point& last, double time, double dt) {
    bool jumped = false;
    for (int i = 0; i < N; ++i) {
      const double a = rates_[i].acceleration + std::abs(desired_.a[i] - last.a[i]) / 2;
      const double dv = dt * (desired_.a[i] + last.a[i]) / 2;
      jumped |= std::abs(desired_.v[i] - last.v[i] - dv) > a * dt + 1e-9 ||
                std::abs(desired_.x[i] - last.x[i] - dt * (last.v[i] + dv / 2)) > a * dt * dt + 1e-9;
    }
    if (jumped && buffered_) {
      const Vector dx = out_.x + dt * (out_.v + dt / 2 * out_.a) - desired_.x, dv = out_.v + dt * out_.a - desired_.v;
      const Vector da = out_.a - desired_.a;
      for (int i = 0; i < N; ++i) {
        fade_.in.current_position[i] = dx[i];
        fade_.in.current_velocity[i] = dv[i];
        fade_.in.current_acceleration[i] = da[i];
      }
      fade_start_ = time;
      fade_end_ = fade_.plan() ? time + fade_.trajectory.get_duration() : time;
    }
    out_ = desired_;
    if (time >= fade_end_) return;
    std::array<double, N> x, v, a;
    fade_.trajectory.at_time(time - fade_start_, x, v, a);
    out_.x += Vector::Map(x.data());
    out_.v += Vector::Map(v.data());
    out_.a += Vector::Map(a.data());
  }

  std::optional<double> given_delay_, timeout_;
  std::array<models::Limits::Rates, N> rates_;
  RuckigPlanner<N> planner_;

  bool buffered_ = false, limited_ = false;
  double time_ = 0;  // s
  std::optional<double> heard_;  // s of the clock, when the last target came, or the start; none: since the last point
  Point desired_, out_;
  std::optional<Vector> wished_;  // the newest target since the last point, that is gone to at once

  double plan_start_ = 0;  // s
  bool planned_ = false, braked_ = true;
  bool ran_out_ = false;  // of knots, of which the last was at last_
  Vector end_ = Vector::Zero(), last_ = Vector::Zero();

  std::array<Knot, kKnots> knots_;  // a ring
  int first_ = 0;
  int count_ = 0;
  double clock_ = kNever;  // ours less the publisher's, s
  double period_ = 0, delay_ = 0, wanted_delay_ = kLeastDelay;  // s

  RuckigPlanner<N> fade_;  // of out_ less desired_
  double fade_start_ = 0, fade_end_ = -1;  // s
};

}  // namespace realtime
