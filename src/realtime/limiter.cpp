#include "realtime/limiter.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "realtime/rotation.hpp"
#include "realtime/ruckig_planner.hpp"
#include "realtime/shortened.hpp"
#include "realtime/tick.hpp"

namespace realtime {
namespace {

constexpr int kJoints = 7;

// Share of each limit that leaves this room: the rest is for rounding on the wire and in the robot.
constexpr double kShare = 0.98;
// Share that a motion which catches up is planned with; the difference keeps it clear of the checks.
constexpr double kPlanShare = 0.96;
// Share of the jerk limits that steps planned here use where there is room. A robot that has lost n commands in a row,
// and went on with constant acceleration, sees (n+1)(n+2)(n+3)/6 times the jerk when the next arrives: three may be lost.
constexpr double kGentleJerk = 0.05;
constexpr int kMostEffort = 6;      // from that to all of the jerk, then from what may be borne to all of the acceleration
// s in which a pose that catches up gives back the acceleration it has, at least: with gentle jerk alone one that was left in
// mid-motion would be led far astray.
constexpr double kGiveBack = 0.03;
// Share that a pose brakes with where that does not do, and with which an acceleration is given back that would lead beyond a
// reduced velocity; and how near to a limit of acceleration or jerk a brake may lead.
constexpr double kHardJerk = 0.5;
constexpr double kMostStrain = 0.85;
// Share of the joints' limits that a pose's reference may use, where the map from one to the other is known for this
// cycle alone; the lesser share for steps planned here, as the map changes on their way; and the share of acceleration
// that a pose of constant velocity may ask of them because the map changes.
constexpr double kAlongShare = 0.85;
constexpr double kAlongPlanShare = 0.7;
constexpr double kAlongDriftShare = 0.35;
// Nearer to a singularity than this (determinant of the Jacobian, 0.037 at home) the joints of a robot no longer go along as
// foreseen, as it has to damp them: a pose is stopped before, and goes only away from it. Where it begins at one (kSingular) it
// stays, as even the slowest motion of it may be a fast one of the joints.
constexpr double kLeastDeterminant = 1e-3;
constexpr double kLeastPace = 1e-5;   // s to rest of a motion so slow that how it changes the map is rounding
constexpr double kLeastAhead = 0.02;  // s, over which the change of the map is looked at, at least
constexpr double kAlongMargin = 0.02;  // rad to the end of a joint's range
constexpr double kAlongDelay = 0.03;  // s until a stop decelerates as planned: its jerk is limited
// Least share of a velocity or acceleration limit that catching up may use for itself.
constexpr double kLeastShare = 0.05;
// Left between a braking motion and FR3's velocity envelope, rad/s: a backward difference over 1 ms lags
// by a quarter of it at most.
constexpr double kEnvelopeSlack = 0.02;
constexpr double kGentleSlack = 0.03;  // likewise where it does not take all that the joint has, so that it need not on the way
constexpr double kAheadOnWay = 0.02;  // s, in which a motion gently begins to slow down as the envelope does
// A motion slower than this is rest; rad/s or m/s, and rad/s² or m/s².
constexpr double kRestVelocity = 1e-6;
constexpr double kRestAcceleration = 1e-3;
constexpr double kRounding = 1 + 1e-6;
constexpr double kStray = 1e-4;     // rad/s or m/s between a robot's reference and ours: a fiftieth of what the jerk changes in a cycle
constexpr double kMismatch = 0.05;  // of a limit, between the derivatives that a reference has and those of its positions
constexpr double kStuckWay = 1e-3;  // rad, m that is no way made
constexpr int kStuckCycles = 500;
constexpr double kWayStep = 0.005;  // rad, m between the places of a way to rest, at most where there are enough of them

// Of one coordinate: the step to the next output, and velocity and acceleration at its end.
struct Step {
  double delta, velocity, acceleration;
};

// The motion within one cycle of constant jerk.
Step constant_jerk(double velocity, double acceleration, double jerk, double dt) {
  return {dt * (velocity + dt * (acceleration / 2 + dt * jerk / 6)), velocity + dt * (acceleration + dt * jerk / 2),
          acceleration + dt * jerk};
}

// To rest at zero.
template <std::size_t N>
struct Planner : RuckigPlanner<N> {
  using RuckigPlanner<N>::in, RuckigPlanner<N>::trajectory;

  Planner() {
    in.synchronization = ruckig::Synchronization::None;
    in.current_position.fill(0);
    in.target_position.fill(0);
    in.target_velocity.fill(0);
    in.target_acceleration.fill(0);
    in.max_velocity.fill(0);
    in.min_velocity = in.max_velocity;
    in.min_acceleration = in.max_velocity;
  }

  // The step that the plan makes in its first dt seconds.
  void step(double dt, std::array<Step, N>& out) const noexcept {
    std::array<double, N> p, v, a;
    trajectory.at_time(dt, p, v, a);
    for (std::size_t i = 0; i < N; ++i) out[i] = {p[i] - in.current_position[i], v[i], a[i]};
  }

  // Coordinate i is as good as at its goal: the checks see to it that the rest is within the limits.
  bool arrives(std::size_t i, double dt) const noexcept {
    return trajectory.get_independent_min_durations()[i] <= 2 * dt;
  }
};

ruckig::Synchronization synchronization(bool straight) {
  return straight ? ruckig::Synchronization::Phase : ruckig::Synchronization::None;
}

bool is_valid(const Reference& reference) {
  constexpr double kRounding = 1e-6;
  if (!is_finite(reference)) return false;
  return reference.motion == Channels::kJoint || std::abs(reference.cartesian.orientation.norm() - 1) < kRounding;
}

Vector6 twist(const Vector3& linear, const Vector3& angular) {
  Vector6 out;
  out.head<3>() = linear;
  out.tail<3>() = angular;
  return out;
}

std::size_t places_on(double way, std::size_t most) {
  return std::clamp<std::size_t>(static_cast<std::size_t>(std::ceil(way / kWayStep)), 1, most);
}

// One joint. v and a are backward differences of the outputs, as the robot sees them; velocity and acceleration are those of
// the motion at the last output.
struct Joint {
  double q = 0, v = 0, a = 0;
  double velocity = 0, acceleration = 0;
  bool held = false;  // it has not caught up yet
  std::optional<int> effort;  // of kMostEffort, with which it goes to rest, where a way to rest has been planned

  bool rests() const {
    return std::abs(v) <= kRestVelocity && std::abs(velocity) <= kRestVelocity && std::abs(a) <= kRestAcceleration &&
           std::abs(acceleration) <= kRestAcceleration;
  }
};

// Translation or rotation: as Joint, in the axes of O.
struct Part {
  models::Limits::Rates limits{};
  Vector3 v = Vector3::Zero(), a = Vector3::Zero();
  Vector3 velocity = Vector3::Zero(), acceleration = Vector3::Zero();
  bool held = false;

  bool rests() const {
    return v.norm() <= kRestVelocity && velocity.norm() <= kRestVelocity && a.norm() <= kRestAcceleration &&
           acceleration.norm() <= kRestAcceleration;
  }
};

// A joint or part whose outputs went on with constant acceleration. It is not held any more: whoever leads the reference on begins
// from there (Rejoin), and a catching up that each loss sets back would never arrive.
template <typename Each>
void goes_on(Each& each, double dt) {
  each.velocity = each.v + dt / 2 * each.a;
  each.acceleration = each.a;
  each.held = false;
}

// All that an output is continued from.
struct Motion {
  std::array<Joint, kJoints> joints{};
  Part translation, rotation;
  Vector3 position = Vector3::Zero();
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  // The joints that the robot moves along with the pose, differences of their positions as for Joint.
  Vector7 along_v = Vector7::Zero(), along_a = Vector7::Zero();

  void coast(Channels motion, double dt) {
    if (motion == Channels::kJoint) {
      for (Joint& joint : joints) {
        joint.v += dt * joint.a;
        joint.q += dt * joint.v;
        goes_on(joint, dt);
      }
      return;
    }
    for (Part* part : {&translation, &rotation}) {
      part->v += dt * part->a;
      goes_on(*part, dt);
    }
    along_v += dt * along_a;
    position += dt * translation.v;
    orientation = (exp(dt * rotation.v) * orientation).normalized();
  }

  // Goes on from what a robot says of its reference, `cycles` - 1 after this. Its position is taken only where it differs by more
  // than rounding.
  void adopt(const Reference& robots, int cycles, double rounding, double dt) {
    for (int n = 1; n < cycles; ++n) coast(robots.motion, dt);
    const bool here = distance(robots) < rounding;
    if (robots.motion == Channels::kJoint) {
      for (int i = 0; i < kJoints; ++i) {
        Joint& joint = joints[i];
        joint.v = robots.joint.dq[i];
        joint.a = robots.joint.ddq[i];
        if (!here) joint.q = robots.joint.q[i];
        for (int n = 1; n < cycles; ++n) {
          joint.q -= dt * joint.v;
          joint.v -= dt * joint.a;
        }
        goes_on(joint, dt);
      }
      return;
    }
    if (!here) {
      position = robots.cartesian.position;
      orientation = robots.cartesian.orientation;
    }
    translation.v = robots.cartesian.velocity.head<3>();
    translation.a = robots.cartesian.acceleration.head<3>();
    rotation.v = robots.cartesian.velocity.tail<3>();
    rotation.a = robots.cartesian.acceleration.tail<3>();
    for (int n = 1; n < cycles; ++n) {
      position -= dt * translation.v;
      orientation = (exp(-dt * rotation.v) * orientation).normalized();
      for (Part* part : {&translation, &rotation}) part->v -= dt * part->a;
    }
    for (Part* part : {&translation, &rotation}) goes_on(*part, dt);
  }

  // From positions; rad, or m and the sine of an angle.
  double distance(const Reference& from) const {
    if (from.motion == Channels::kJoint) {
      double most = 0;
      for (int i = 0; i < kJoints; ++i) most = std::max(most, std::abs(joints[i].q - from.joint.q[i]));
      return most;
    }
    return std::max((position - from.cartesian.position).cwiseAbs().maxCoeff(),
                    2 * (orientation.conjugate() * from.cartesian.orientation).vec().cwiseAbs().maxCoeff());
  }

  // From velocities too, rad/s or m/s: a lost output shows there first.
  double difference(const Reference& from) const {
    double most = distance(from);
    if (from.motion != Channels::kJoint) return std::max(most, (twist(translation.v, rotation.v) - from.cartesian.velocity).cwiseAbs().maxCoeff());
    for (int i = 0; i < kJoints; ++i) most = std::max(most, std::abs(joints[i].v - from.joint.dq[i]));
    return most;
  }

  void write(JointReference& out) const {
    for (int i = 0; i < kJoints; ++i) {
      out.q[i] = joints[i].q;
      out.dq[i] = joints[i].velocity;
      out.ddq[i] = joints[i].acceleration;
    }
  }
  void write(CartesianReference& out) const {
    out.position = position;
    out.orientation = orientation;
    out.velocity << translation.velocity, rotation.velocity;
    out.acceleration << translation.acceleration, rotation.acceleration;
  }
  void write(Channels motion, Reference& out) const {
    out.motion = motion;
    motion == Channels::kJoint ? write(out.joint) : write(out.cartesian);
  }
};

}  // namespace

struct Limiter::Impl : Motion {
  models::Limits limits;
  models::Limits asked;  // of what is followed
  bool reduced = false;  // they are less
  Vector7 fastest = Vector7::Constant(std::numeric_limits<double>::infinity());  // likewise, rad/s
  bool bounded = false;  // it is finite
  double braking = 1, spared = 1;  // shares of the joints' acceleration with which they brake, and catch up

  Channels motion = Channels::kJoint;
  Reference last;  // output
  Motion before;   // the last output
  Motion doubt;    // of the robot, if it has not got the last outputs
  bool in_doubt = false;

  bool has_along = false, along_robots = true;
  JointsOfPose along;
  Matrix76 along_change = Matrix76::Zero();  // of along.dq_dP in a second of the present motion
  double along_determinant = 1, along_nearing = 0;  // its size, and how much it shrinks in a second of that
  double ahead = kLeastAhead;                // s to halfway to rest

  Reference stuck_at;  // since so many cycles
  int stuck_cycles = 0;
  bool again = false;  // the cycle's step was taken back

  Planner<kJoints> joint_follow, joint_brake;
  Planner<3> part_follow;
  Planner<1> stop;

  explicit Impl(const models::Limits& of) : limits(of), asked(of) {
    translation.limits = limits.translation;
    rotation.limits = limits.rotation;
    joint_brake.in.control_interface = ruckig::ControlInterface::Velocity;
    stop.in.control_interface = ruckig::ControlInterface::Velocity;
  }

  // To rest in the shortest time with these limits of acceleration and jerk.
  bool plan_stop(double position, double velocity, double acceleration, double A, double J) noexcept {
    auto& in = stop.in;
    in.current_position[0] = position;
    in.current_velocity[0] = velocity;
    in.current_acceleration[0] = acceleration;
    in.max_acceleration[0] = A;
    (*in.min_acceleration)[0] = -A;
    in.max_jerk[0] = J;
    return stop.plan();
  }

  // --- joints ---------------------------------------------------------------------------------

  // From there the joint can brake to rest, with these limits, without leaving its range or its velocity envelope.
  bool can_stop(int i, double q, double velocity, double acceleration, double A, double J, double slack = kEnvelopeSlack) noexcept {
    // Seen in the direction of motion towards the limit: the mirror image serves the other one.
    const double reserve = acceleration * acceleration / (2 * J);
    const double up = std::max({velocity, velocity + (acceleration > 0 ? reserve : 0), 0.0});
    const double down = std::max({-velocity, -velocity + (acceleration < 0 ? reserve : 0), 0.0});
    if (up > kShare * limits.dq_max[i] * kRounding || down > kShare * limits.dq_max[i] * kRounding) {
      return false;
    }

    // Cheap bounds first: a stop is no longer than this.
    const auto bound = [&](double v) { return v * (v / (2 * A) + 4 * A / J); };
    const double q_up = q + bound(up);
    const double q_down = q - bound(down);
    if (q_up <= limits.q_max[i] && q_down >= limits.q_min[i] &&
        up <= kShare * limits.dq_upper(i, q_up) - slack &&
        -down >= kShare * limits.dq_lower(i, q_down) + slack) {
      return true;
    }

    if (!plan_stop(q, velocity, acceleration, A, J)) return false;
    constexpr int kSamples = 24;
    for (int k = 0; k <= kSamples; ++k) {
      const double share = static_cast<double>(k) / kSamples;  // densest where it has not slowed down yet, and the envelope does
      std::array<double, 1> p, v, a;
      stop.trajectory.at_time(stop.trajectory.get_duration() * share * share, p, v, a);
      if (p[0] > std::max(limits.q_max[i], q) || p[0] < std::min(limits.q_min[i], q)) return false;
      if (v[0] > kEnvelopeSlack / 100 && v[0] > kShare * limits.dq_upper(i, p[0]) - slack) {
        return false;
      }
      if (v[0] < -kEnvelopeSlack / 100 && v[0] < kShare * limits.dq_lower(i, p[0]) + slack) {
        return false;
      }
    }
    return true;
  }

  // The robot takes that step, and there is a way to rest after it.
  bool admissible(int i, const Step& step, double dt) noexcept {
    const Joint& joint = joints[i];
    const double q = joint.q + step.delta;
    const double v = step.delta / dt;
    const double a = (v - joint.v) / dt;
    const double j = (a - joint.a) / dt;
    if (!(std::abs(a) <= kShare * limits.ddq_max[i] * kRounding) ||
        !(std::abs(j) <= kShare * limits.dddq_max[i] * kRounding)) {
      return false;
    }
    if (v > 0 && (q > limits.q_max[i] || v > kShare * limits.dq_upper(i, q) * kRounding)) return false;
    if (v < 0 && (q < limits.q_min[i] || v < kShare * limits.dq_lower(i, q) * kRounding)) return false;
    return can_stop(i, q, step.velocity, step.acceleration, kShare * limits.ddq_max[i], kShare * limits.dddq_max[i]);
  }

  // After that step there is a way to rest too that all joints bear, with that share of the jerk.
  bool leaves_room(int i, const Step& step, double share, double slack) noexcept {
    return can_stop(i, joints[i].q + step.delta, step.velocity, step.acceleration, kShare * braking * limits.ddq_max[i],
                    share * limits.dddq_max[i], slack);
  }

  bool restrained() const { return reduced || bounded; }

  // Nothing else keeps what is reduced, and at kLeastShare more a goal that is faster is followed.
  double plan_share() const { return restrained() ? kPlanShare / (1 + kLeastShare) : kPlanShare; }

  // In following; most where such an acceleration must be given back before the velocity has changed by `room`.
  double follow_jerk(int i, double acceleration, double room) const {
    return restrained() ? std::clamp(giving_back(acceleration, room), gentle_jerk(i), most_jerk(i)) : gentle_jerk(i);
  }
  double gentle_jerk(int i) const { return std::min(kGentleJerk * limits.dddq_max[i], most_jerk(i)); }
  double most_jerk(int i) const { return std::min(kHardJerk * limits.dddq_max[i], kPlanShare * asked.dddq_max[i]); }
  static double giving_back(double acceleration, double room) { return acceleration * acceleration / (2 * std::max(room, 1e-9)); }

  // The velocity that a joint comes to while it gives its acceleration back.
  double velocity_to_come(int i, double velocity, double acceleration) const {
    return velocity + acceleration * std::abs(acceleration) / (2 * (restrained() ? most_jerk(i) : gentle_jerk(i)));
  }

  // That step, and what must come of it, are inside what may be asked for.
  bool may_be_asked(int i, const Step& step, double dt) const {
    if (!restrained()) return true;
    const double v = step.delta / dt;
    const double a = (v - joints[i].v) / dt;
    const double j = (a - joints[i].a) / dt;
    const double fastest_here = std::min(kShare * asked.dq_max[i], fastest[i]) * kRounding;
    return std::abs(v) <= fastest_here && std::abs(velocity_to_come(i, step.velocity, step.acceleration)) <= fastest_here &&
           std::abs(a) <= kShare * asked.ddq_max[i] * kRounding && std::abs(j) <= kShare * asked.dddq_max[i] * kRounding;
  }

  // What a step that is asked for means when it is taken as it is.
  Step as_wanted(const Joint& joint, double q, double dt) const {
    const double delta = q - joint.q;
    const double v = delta / dt;
    const double a = (v - joint.v) / dt;
    return {delta, v + a * dt / 2, a};
  }

  // `q` is where the step leads: joint.q + step.delta, or exactly what was asked for.
  void take(Joint& joint, double q, const Step& step, double dt) const {
    const double v = step.delta / dt;
    joint.a = (v - joint.v) / dt;
    joint.v = v;
    joint.q = q;
    joint.velocity = step.velocity;
    joint.acceleration = step.acceleration;
  }

  // Next to the end of its range, or of its envelope, a joint takes as much more as it needs, until it rests: others bear it too.
  bool plan_brake(bool soon) noexcept {
    const double gentle = soon ? kSoonJerk : kGentleJerk;
    for (int i = 0; i < kJoints; ++i) {
      double A, J;
      const auto make = [&](int effort) {
        const double more = 2. * effort / kMostEffort, quicker = std::min(more, 1.), stronger = std::max(more - 1, 0.);
        A = (braking + (1 - braking) * stronger) * kShare * limits.ddq_max[i];
        J = (gentle + (kShare - gentle) * quicker * quicker) * limits.dddq_max[i];
      };
      Joint& joint = joints[i];
      int effort = joint.effort.value_or(0);
      make(effort);
      const auto does = [&] { return can_stop(i, joint.q, joint.velocity, joint.acceleration, A, J, kGentleSlack); };
      while (!joint.effort && effort < kMostEffort && !does()) make(++effort);
      joint.effort = effort;
      joint_brake.in.max_acceleration[i] = A;
      (*joint_brake.in.min_acceleration)[i] = -A;
      joint_brake.in.max_jerk[i] = J;
      joint_brake.in.current_velocity[i] = joints[i].velocity;
      joint_brake.in.current_acceleration[i] = joints[i].acceleration;
    }
    return joint_brake.plan();
  }

  void brake_steps(double dt, std::array<Step, kJoints>& steps, bool soon = false) noexcept {
    const bool gentle = plan_brake(soon);
    if (gentle) joint_brake.step(dt, steps);
    for (int i = 0; i < kJoints; ++i) {
      if (!gentle || !admissible(i, steps[i], dt)) steps[i] = hard_brake_step(i, dt);
    }
  }

  Step hard_brake_step(int i, double dt) noexcept {
    const double J = kShare * limits.dddq_max[i];
    if (plan_stop(0, joints[i].velocity, joints[i].acceleration, kShare * limits.ddq_max[i], J)) {
      std::array<Step, 1> step;
      stop.step(dt, step);
      return step[0];
    }
    return constant_jerk(joints[i].velocity, joints[i].acceleration,  // at least no acceleration
                         std::clamp(-joints[i].acceleration / dt, -J, J), dt);
  }

  // Plans in coordinates relative to what is wanted, which moves on: there the goal is rest at zero, and
  // the limits leave room for the wanted motion.
  bool follow_steps(const JointReference& wanted, double dt, bool straight, std::array<Step, kJoints>& steps) noexcept {
    auto& in = joint_follow.in;
    in.synchronization = synchronization(straight);
    Vector7 velocity, acceleration;
    for (int i = 0; i < kJoints; ++i) {
      const double V = std::min(plan_share() * asked.dq_max[i], fastest[i]);
      const double A = std::min(plan_share() * asked.ddq_max[i], kPlanShare * spared * limits.ddq_max[i]);
      const double q = std::clamp(wanted.q[i], limits.q_min[i], limits.q_max[i]);
      const bool inside = q == wanted.q[i];
      velocity[i] = inside ? std::clamp(wanted.dq[i], -V, V) : 0;
      const bool too_fast = restrained() && std::abs(wanted.dq[i]) > V;
      acceleration[i] = inside && !too_fast ? std::clamp(wanted.ddq[i], -A, A) : 0;
      // Where `wanted` was at the last output, if it moved as it says.
      const double before = q - dt * (velocity[i] - dt * acceleration[i] / 2);
      in.current_position[i] = joints[i].q - before;
      in.current_velocity[i] = joints[i].velocity - (velocity[i] - dt * acceleration[i]);
      in.current_acceleration[i] = joints[i].acceleration - acceleration[i];
      const double ahead = joints[i].q + kAheadOnWay * joints[i].velocity;
      const double upper = std::min(V, kPlanShare * limits.dq_upper(i, ahead));
      const double lower = std::max(-V, kPlanShare * limits.dq_lower(i, ahead));
      in.max_velocity[i] = std::max(upper - velocity[i], kLeastShare * V);
      (*in.min_velocity)[i] = std::min(lower - velocity[i], -kLeastShare * V);
      in.max_acceleration[i] = std::max(A - acceleration[i], kLeastShare * A);
      (*in.min_acceleration)[i] = std::min(-A - acceleration[i], -kLeastShare * A);
      const double room = in.current_acceleration[i] > 0 ? in.max_velocity[i] - in.current_velocity[i]
                                                         : in.current_velocity[i] - (*in.min_velocity)[i];
      in.max_jerk[i] = follow_jerk(i, in.current_acceleration[i], room);
    }
    if (!joint_follow.plan()) return false;
    joint_follow.step(dt, steps);
    for (int i = 0; i < kJoints; ++i) {
      steps[i].delta += dt * (velocity[i] - dt * acceleration[i] / 2);
      steps[i].velocity += velocity[i];
      steps[i].acceleration += acceleration[i];
    }
    return true;
  }

  bool follow(const JointReference& wanted, double dt, bool straight, JointReference& out) noexcept {
    std::array<bool, kJoints> pass;
    bool all = true;
    for (int i = 0; i < kJoints; ++i) {
      const Step step = as_wanted(joints[i], wanted.q[i], dt);
      pass[i] = std::abs(wanted.dq[i]) <= asked.dq_max[i] && std::abs(wanted.ddq[i]) <= asked.ddq_max[i] &&
                may_be_asked(i, step, dt) && admissible(i, step, dt) && leaves_room(i, step, kSoonJerk, kEnvelopeSlack);
      all &= pass[i] && !joints[i].held;
    }
    std::array<Step, kJoints> follow, brake;
    bool has_follow = false, has_brake = false;
    if (!all) has_follow = follow_steps(wanted, dt, straight, follow);
    std::array<Joint, kJoints> next = joints;
    all = true;
    for (int i = 0; i < kJoints; ++i) {
      // A joint on its way may meet the wanted position in passing: that is not yet to have caught up.
      if (joints[i].held) pass[i] = pass[i] && has_follow && joint_follow.arrives(i, dt);
      next[i].held = !pass[i];
      next[i].effort.reset();
      all &= pass[i];
      if (pass[i]) {
        take(next[i], wanted.q[i], as_wanted(joints[i], wanted.q[i], dt), dt);
      } else if (has_follow && admissible(i, follow[i], dt) && leaves_room(i, follow[i], kGentleJerk, kGentleSlack)) {
        take(next[i], joints[i].q + follow[i].delta, follow[i], dt);
      } else {
        if (!has_brake) brake_steps(dt, brake);
        has_brake = true;
        take(next[i], joints[i].q + brake[i].delta, brake[i], dt);
      }
    }
    joints = next;
    write(out);
    for (int i = 0; i < kJoints; ++i) {
      if (!pass[i]) continue;
      // Derivatives that are not those of the positions would step a torque, or a velocity: then the differences count.
      const Joint& joint = joints[i];
      if (std::abs(wanted.dq[i] - joint.velocity) > kMismatch * limits.dq_max[i]) continue;
      // Differences lag by half a cycle.
      if (std::abs(wanted.ddq[i] - joint.acceleration) > kMismatch * limits.ddq_max[i] + dt * limits.dddq_max[i]) continue;
      out.dq[i] = wanted.dq[i];
      out.ddq[i] = wanted.ddq[i];
    }
    return !all;
  }

  // --- pose -----------------------------------------------------------------------------------

  struct PartStep {
    Vector3 delta, velocity, acceleration;
  };

  bool admissible(const Part& part, const PartStep& step, double dt) const noexcept {
    const Vector3 v = step.delta / dt;
    const Vector3 a = (v - part.v) / dt;
    const Vector3 j = (a - part.a) / dt;
    // Braking first takes the acceleration to zero, which brings the velocity to `last`.
    const Vector3 last =
        step.velocity + step.acceleration * (step.acceleration.norm() / (2 * kShare * part.limits.jerk));
    return v.norm() <= kShare * part.limits.velocity * kRounding &&
           a.norm() <= kShare * part.limits.acceleration * kRounding &&
           j.norm() <= kShare * part.limits.jerk * kRounding &&
           last.norm() <= kShare * part.limits.velocity * kRounding;
  }

  const models::Limits::Rates& asked_of(const Part& part) const {
    return &part == &translation ? asked.translation : asked.rotation;
  }

  // As for joints.
  bool may_be_asked(const Part& part, const PartStep& step, double dt) const {
    if (!reduced) return true;
    const models::Limits::Rates& most = asked_of(part);
    const Vector3 v = step.delta / dt;
    const Vector3 a = (v - part.v) / dt;
    const Vector3 j = (a - part.a) / dt;
    const double J = std::min(kHardJerk * part.limits.jerk, kPlanShare * most.jerk);
    const Vector3 last = step.velocity + step.acceleration * (step.acceleration.norm() / (2 * J));
    return std::max(v.norm(), last.norm()) <= kShare * most.velocity * kRounding &&
           a.norm() <= kShare * most.acceleration * kRounding && j.norm() <= kShare * most.jerk * kRounding;
  }
  bool joints_may_be_asked(const PartStep& linear, const PartStep& angular, double dt) const {
    if (!reduced || !has_along) return true;
    const Vector7 v = along.dq_dP * twist(linear.delta, angular.delta) / dt;
    const Vector7 a = (v - along_v) / dt;
    const Vector7 j = (a - along_a) / dt;
    for (int i = 0; i < kJoints; ++i) {
      if (!(std::abs(v[i]) <= kShare * asked.dq_max[i] && std::abs(a[i]) <= kShare * asked.ddq_max[i] &&
            std::abs(j[i]) <= kShare * asked.dddq_max[i])) {
        return false;
      }
    }
    return true;
  }

  // With which a part gives such an acceleration back in following, of what it may use for itself.
  double give_back_jerk(const Part& part, const models::Limits::Rates& own, const Vector3& acceleration) const {
    const double a = acceleration.norm(), room = kPlanShare * own.velocity - (a > 0 ? part.velocity.dot(acceleration) / a : 0);
    const double wanted = std::max(a / kGiveBack, reduced ? giving_back(a, room) : 0);
    return std::min(std::clamp(wanted, kGentleJerk * own.jerk, kHardJerk * own.jerk), kPlanShare * asked_of(part).jerk);
  }

  PartStep as_wanted(const Part& part, const Vector3& delta, double dt) const {
    const Vector3 v = delta / dt;
    const Vector3 a = (v - part.v) / dt;
    return {delta, v + a * (dt / 2), a};
  }

  void take(Part& part, const PartStep& step, double dt) const {
    const Vector3 v = step.delta / dt;
    part.a = (v - part.v) / dt;
    part.v = v;
    part.velocity = step.velocity;
    part.acceleration = step.acceleration;
  }

  // What the joints accelerate with at this twist if it stays as it is, rad/s². The change of the map is that of the present
  // motion, and goes with its speed.
  Vector7 drift(const Vector6& P) const noexcept {
    return faster(P) * (along_change * P);
  }

  // How many times as fast as the present motion a twist is; none where that tells nothing of how the map changes.
  double faster(const Vector6& P) const noexcept {
    const double now = pace(twist(translation.velocity, rotation.velocity));
    return now > kLeastPace ? pace(P) / now : 0;
  }

  // Of a twist: s to rest with all the acceleration that the limits of the pose itself allow.
  double pace(const Vector6& P) const noexcept {
    return std::hypot(P.head<3>().norm() / translation.limits.acceleration, P.tail<3>().norm() / rotation.limits.acceleration);
  }

  // The shortest time in which both parts come to rest with constant deceleration, s. Their joints and they themselves
  // keep their limits of acceleration.
  // `drifts`: as long as the joints drift as now, which those that grow faster by it may be braked the harder for.
  double stop_time(const Vector3& linear, const Vector3& angular, bool drifts = false) const noexcept {
    double time = std::max(linear.norm() / translation.limits.acceleration, angular.norm() / rotation.limits.acceleration) /
                  kShare;
    if (!has_along) return time;
    const Vector6 P = twist(linear, angular);
    const Vector7 v = along.dq_dP * P;
    const Vector7 drift_now = drift(P);
    for (int i = 0; i < kJoints; ++i) {
      const double drift = v[i] > 0 ? -drift_now[i] : drift_now[i];
      const double A = kAlongPlanShare * limits.ddq_max[i];
      time = std::max(time, std::abs(v[i]) / std::max(A - (drifts ? drift : std::max(drift, 0.)), A / 4));
    }
    return time;
  }

  // What this part may use for itself in any direction, each half of what the joints can.
  models::Limits::Rates own_limits(const Part& part) const noexcept {
    models::Limits::Rates own = {asked_of(part).velocity, asked_of(part).acceleration, part.limits.jerk};
    if (!has_along) return own;
    for (int i = 0; i < kJoints; ++i) {
      const double share = kAlongPlanShare / 2 / along.dq_dP.row(i).segment<3>(&part == &translation ? 0 : 3).norm();
      own.velocity = std::min(own.velocity, share * asked.dq_max[i]);
      own.acceleration = std::min(own.acceleration, share * asked.ddq_max[i]);
      own.jerk = std::min(own.jerk, share * limits.dddq_max[i]);
    }
    // As fast as keeps the drift, which goes with the square of the speed.
    const double excess = drift_excess(twist(translation.velocity, rotation.velocity));
    constexpr double kNear = 0.5;
    if (excess > kNear) {
      own.velocity = std::clamp(part.velocity.norm() * std::sqrt(kNear / excess), kLeastShare * own.velocity, own.velocity);
    }
    return own;
  }

  bool is_singular() const noexcept { return has_along && along_robots && along_determinant < kSingular; }

  // The drift by what it may be, of the joint that has most of it.
  double drift_excess(const Vector6& P) const noexcept {
    const Vector7 all = drift(P);
    double most = 0;
    for (int i = 0; i < kJoints; ++i) most = std::max(most, std::abs(all[i]) / (kAlongDriftShare * limits.ddq_max[i]));
    return most;
  }

  // The joints can go along with these steps, and come to rest after them.
  bool along_admissible(const PartStep& linear, const PartStep& angular, double dt) const noexcept {
    if (!has_along) return true;
    const Vector7 v = along.dq_dP * twist(linear.delta, angular.delta) / dt;
    const Vector7 a = (v - along_v) / dt;
    const Vector7 j = (a - along_a) / dt;
    const Vector6 P = twist(linear.velocity, angular.velocity);
    if (drift_excess(P) > 1) return false;
    const double time = stop_time(linear.velocity, angular.velocity);
    const double nearing = along_nearing * faster(P);
    if (along_robots && nearing > 0 && along_determinant - nearing * (time / 2 + kAlongDelay) < kLeastDeterminant) return false;
    constexpr int kSamples = 4;
    for (int i = 0; i < kJoints; ++i) {
      if (!(std::abs(a[i]) <= kAlongShare * limits.ddq_max[i]) || !(std::abs(j[i]) <= kAlongShare * limits.dddq_max[i])) {
        return false;
      }
      // On as now for the delay, then to rest at a constant rate.
      const double speed = v[i] * a[i] > 0 ? v[i] + a[i] * kAlongDelay / 2 : v[i];
      const double begin = along.q[i] + v[i] * dt + speed * kAlongDelay;
      const auto forbidden = [&](double q, double velocity) {
        return velocity > 0 ? q > limits.q_max[i] - kAlongMargin || velocity > kAlongShare * limits.dq_upper(i, q)
                            : q < limits.q_min[i] + kAlongMargin || velocity < kAlongShare * limits.dq_lower(i, q);
      };
      if (std::abs(speed) < kEnvelopeSlack / 100 || !forbidden(begin + speed * time / 2, speed)) continue;
      for (int k = 0; k <= kSamples; ++k) {
        const double passed = static_cast<double>(k) / kSamples;
        const double velocity = std::max(1 - passed, kEnvelopeSlack / 100) * speed;
        if (forbidden(begin + speed * time * (passed - passed * passed / 2), velocity)) return false;
      }
    }
    return true;
  }

  // As for joints, with per-axis limits that keep the norms.
  bool follow_step(const Part& part, const Vector3& delta, const Vector3& wanted_velocity,
                   const Vector3& wanted_acceleration, double dt, bool straight, PartStep& step) noexcept {
    const models::Limits::Rates own = own_limits(part);
    const double V = plan_share() * own.velocity;
    const double A = plan_share() * own.acceleration;
    const Vector3 velocity = shortened(wanted_velocity, V);
    const bool too_fast = reduced && wanted_velocity.norm() > V;
    const Vector3 acceleration = too_fast ? Vector3::Zero().eval() : shortened(wanted_acceleration, A);
    const double J = give_back_jerk(part, own, part.acceleration - acceleration);
    const double axis = 1 / std::sqrt(3.0);
    const double V_axis = axis * std::max(V - velocity.norm(), kLeastShare * V);
    const double A_axis = axis * std::max(A - acceleration.norm(), kLeastShare * A);
    const Vector3 moved = dt * (velocity - dt / 2 * acceleration);
    auto& in = part_follow.in;
    in.synchronization = synchronization(straight);
    for (int i = 0; i < 3; ++i) {
      in.current_position[i] = moved[i] - delta[i];
      in.current_velocity[i] = part.velocity[i] - (velocity[i] - dt * acceleration[i]);
      in.current_acceleration[i] = part.acceleration[i] - acceleration[i];
      // One that is ahead may wait.
      in.max_velocity[i] = V_axis - std::min(velocity[i], 0.);
      (*in.min_velocity)[i] = -V_axis - std::max(velocity[i], 0.);
      in.max_acceleration[i] = A_axis - std::min(acceleration[i], 0.);
      (*in.min_acceleration)[i] = -A_axis - std::max(acceleration[i], 0.);
      in.max_jerk[i] = axis * J;
    }
    if (!part_follow.plan()) return false;
    std::array<Step, 3> steps;
    part_follow.step(dt, steps);
    for (int i = 0; i < 3; ++i) {
      step.delta[i] = steps[i].delta + moved[i];
      step.velocity[i] = steps[i].velocity + velocity[i];
      step.acceleration[i] = steps[i].acceleration + acceleration[i];
    }
    return true;
  }

  // Both parts straight back along their velocity, in one time, and what of the acceleration leads aside to zero.
  // `rate` of the deceleration that brings them to rest the soonest, with this share of the jerk.
  void brake_step(double rate, double jerk_share, double dt, PartStep& linear, PartStep& angular) noexcept {
    const Vector6 P = twist(translation.velocity, rotation.velocity);
    const Vector6 dP = twist(translation.acceleration, rotation.acceleration);
    const auto jerk_of = [&](const Vector6& direction) {
      double J = std::numeric_limits<double>::infinity();
      const auto keep = [&](double limit, double part) {
        if (part > 0) J = std::min(J, jerk_share * limit / part);
      };
      keep(translation.limits.jerk, direction.head<3>().norm());
      keep(rotation.limits.jerk, direction.tail<3>().norm());
      if (has_along) {
        const Vector7 joints = (along.dq_dP * direction).cwiseAbs();
        for (int i = 0; i < kJoints; ++i) keep(kAlongShare * limits.dddq_max[i], joints[i]);
      }
      return J;
    };
    Vector6 delta = Vector6::Zero(), v = Vector6::Zero(), a = Vector6::Zero(), aside = dP;
    if (const double n = pace(P); n > 0) {
      const Vector6 u = P / n;  // which is one of pace()
      const double back = dP.head<3>().dot(u.head<3>()) / std::pow(translation.limits.acceleration, 2) +
                          dP.tail<3>().dot(u.tail<3>()) / std::pow(rotation.limits.acceleration, 2);
      const double A = rate * n / stop_time(translation.velocity, rotation.velocity, true);
      const double J = jerk_of(u);
      Step step = constant_jerk(n, back, std::clamp(-back / dt, -J, J), dt);
      if (A > 0 && plan_stop(0, n, back, A, J)) {
        std::array<Step, 1> planned;
        stop.step(dt, planned);
        step = planned[0];
      }
      aside -= back * u;
      delta = step.delta * u;
      v = step.velocity * u;
      a = step.acceleration * u;
    }
    if (const double pull = aside.norm(); pull > 0) {
      const double j = -std::min(jerk_of(aside / pull) / pull, 1 / dt);
      delta += dt * dt * (0.5 + dt * j / 6) * aside;
      v += dt * (1 + dt * j / 2) * aside;
      a += (1 + dt * j) * aside;
    }
    linear = {delta.head<3>(), v.head<3>(), a.head<3>()};
    angular = {delta.tail<3>(), v.tail<3>(), a.tail<3>()};
  }

  // The greatest acceleration or jerk of that step, by its limit.
  double strain(const PartStep& linear, const PartStep& angular, double dt) const noexcept {
    double most = 0;
    const auto see = [&most, dt](double a, double j, double A, double J) {
      most = std::max({most, std::abs(a) / A, std::abs(j) / J});
    };
    for (const auto& [part, step] : {std::pair{&translation, &linear}, std::pair{&rotation, &angular}}) {
      const Vector3 a = (step->delta / dt - part->v) / dt;
      see(a.norm(), (a - part->a).norm() / dt, part->limits.acceleration, part->limits.jerk);
    }
    if (!has_along) return most;
    const Vector7 a = (along.dq_dP * twist(linear.delta, angular.delta) / dt - along_v) / dt;
    const Vector7 j = (a - along_a) / dt;
    for (int i = 0; i < kJoints; ++i) see(a[i], j[i], limits.ddq_max[i], limits.dddq_max[i]);
    return most;
  }

  // Gently where that does; else as hard as may be in this cycle: of a pose whose joints are ours, by its own limits alone. They need
  // not come along where it is out of their reach or they are next to a singularity, and must not keep it from coming to rest.
  void brake_steps(double dt, PartStep& linear, PartStep& angular, bool soon = false) noexcept {
    brake_step(1, soon ? kSoonJerk : kGentleJerk, dt, linear, angular);
    if (admissible(translation, linear, dt) && admissible(rotation, angular, dt) && along_admissible(linear, angular, dt)) {
      return;
    }
    const bool has_joints = std::exchange(has_along, has_along && along_robots);
    double least = std::numeric_limits<double>::infinity();
    for (const double rate : {1., 0.7, 0.4, 0.2, 0.}) {
      PartStep on, about;
      brake_step(rate, kHardJerk, dt, on, about);
      const double most = strain(on, about, dt);
      if (!(most < least)) continue;
      least = most;
      linear = on;
      angular = about;
      if (most <= kMostStrain) break;
    }
    has_along = has_joints;
  }

  void move(const PartStep& linear, const PartStep& angular, double dt) {
    take(translation, linear, dt);
    take(rotation, angular, dt);
    position += linear.delta;
    orientation = (exp(angular.delta) * orientation).normalized();
    if (!has_along) return;
    const Vector7 v = along.dq_dP * twist(translation.v, rotation.v);
    along_a = (v - along_v) / dt;
    along_v = v;
    look_ahead();
  }

  void look_ahead() { ahead = std::max(stop_time(translation.velocity, rotation.velocity) / 2, kLeastAhead); }

  bool follow(const CartesianReference& wanted, double dt, bool straight, CartesianReference& out) noexcept {
    struct Choice {
      Part& part;
      Vector3 delta, velocity, acceleration;
      PartStep wanted, step;
      bool pass;
    };
    const auto choice = [&](Part& part, const Vector3& delta, const Vector3& velocity, const Vector3& acceleration) {
      const PartStep step = as_wanted(part, delta, dt);
      const bool pass = velocity.norm() <= asked_of(part).velocity && acceleration.norm() <= asked_of(part).acceleration &&
                        may_be_asked(part, step, dt) && admissible(part, step, dt);
      return Choice{part, delta, velocity, acceleration, step, step, pass};
    };
    Choice choices[] = {
        choice(translation, wanted.position - position, wanted.velocity.head<3>(), wanted.acceleration.head<3>()),
        choice(rotation, log(wanted.orientation * orientation.conjugate()), wanted.velocity.tail<3>(),
               wanted.acceleration.tail<3>())};
    auto& [linear, angular] = choices;
    if (linear.pass && angular.pass &&
        !(joints_may_be_asked(linear.wanted, angular.wanted, dt) && along_admissible(linear.wanted, angular.wanted, dt))) {
      linear.pass = angular.pass = false;
    }
    bool brake = false;
    for (Choice& c : choices) {
      if (c.pass && !c.part.held) continue;
      // A part on its way may meet the wanted pose in passing: that is not yet to have caught up.
      const bool has_follow = follow_step(c.part, c.delta, c.velocity, c.acceleration, dt, straight, c.step);
      c.part.held = !(c.pass && has_follow && part_follow.arrives(0, dt) && part_follow.arrives(1, dt) &&
                      part_follow.arrives(2, dt));
      if (!c.part.held) {
        c.step = c.wanted;
      } else {
        brake |= !has_follow || !admissible(c.part, c.step, dt);
      }
    }
    if (brake || !along_admissible(linear.step, angular.step, dt)) {
      linear.part.held = angular.part.held = true;
      brake_steps(dt, linear.step, angular.step);
    }
    move(linear.step, angular.step, dt);
    if (!translation.held) position = wanted.position;
    if (!rotation.held) orientation = wanted.orientation;
    write(out);
    const auto fits = [dt](const Part& part, const Vector3& velocity, const Vector3& acceleration) {
      return !part.held && (velocity - part.velocity).norm() <= kMismatch * part.limits.velocity &&
             (acceleration - part.acceleration).norm() <=
                 kMismatch * part.limits.acceleration + dt * part.limits.jerk;
    };
    if (fits(translation, wanted.velocity.head<3>(), wanted.acceleration.head<3>())) {
      out.velocity.head<3>() = wanted.velocity.head<3>();
      out.acceleration.head<3>() = wanted.acceleration.head<3>();
    }
    if (fits(rotation, wanted.velocity.tail<3>(), wanted.acceleration.tail<3>())) {
      out.velocity.tail<3>() = wanted.velocity.tail<3>();
      out.acceleration.tail<3>() = wanted.acceleration.tail<3>();
    }
    return translation.held || rotation.held;
  }

  void watch(bool held) {
    if (!held || distance(stuck_at) > kStuckWay) {
      stuck_cycles = 0;
      stuck_at = last;
    } else if (!again) {
      ++stuck_cycles;
    }
    again = false;
  }

  bool is_last(const Reference& from) const {
    if (from.motion != last.motion) return false;
    if (from.motion == Channels::kJoint) {
      return from.joint.q == last.joint.q && from.joint.dq == last.joint.dq && from.joint.ddq == last.joint.ddq;
    }
    const CartesianReference &a = from.cartesian, &b = last.cartesian;
    return a.position == b.position && a.orientation.coeffs() == b.orientation.coeffs() && a.velocity == b.velocity &&
           a.acceleration == b.acceleration;
  }
};

Limiter::Limiter(const models::Limits& limits) : impl_(std::make_unique<Impl>(limits)) {}
Limiter::~Limiter() = default;

void Limiter::reduce(const models::Limits& asked) noexcept {
  Impl& m = *impl_;
  const auto same = [](const models::Limits::Rates& a, const models::Limits::Rates& b) {
    return a.velocity == b.velocity && a.acceleration == b.acceleration && a.jerk == b.jerk;
  };
  m.asked = asked;
  m.reduced = !(asked.dq_max == m.limits.dq_max && asked.ddq_max == m.limits.ddq_max && asked.dddq_max == m.limits.dddq_max &&
                same(asked.translation, m.limits.translation) && same(asked.rotation, m.limits.rotation));
}

void Limiter::bound(const Vector7& dq) noexcept {
  impl_->fastest = dq;
  impl_->bounded = dq.array().isFinite().any();
}

void Limiter::spare(double braking, double catching_up) noexcept {
  impl_->braking = braking;
  impl_->spared = catching_up;
}

Vector7 Limiter::joint_velocity_to_come() const noexcept {
  Vector7 dq;
  for (int i = 0; i < kJoints; ++i) dq[i] = impl_->velocity_to_come(i, impl_->joints[i].velocity, impl_->joints[i].acceleration);
  return dq;
}

bool Limiter::reset(const Reference& from) noexcept {
  // As if the outputs before had come with constant acceleration: differences lag by half a cycle.
  constexpr double kHalfCycle = 0.0005;  // s
  Impl& m = *impl_;
  m.stuck_cycles = 0;
  m.stuck_at = from;
  if (m.is_last(from)) return true;  // and the differences are known
  m.last = from;
  m.motion = from.motion;
  m.has_along = false;
  m.along_change.setZero();
  m.along_nearing = 0;
  m.ahead = kLeastAhead;
  if (from.motion == Channels::kJoint) {
    for (int i = 0; i < kJoints; ++i) {
      const double dq = from.joint.dq[i], ddq = from.joint.ddq[i];
      m.joints[i] = {from.joint.q[i], dq - kHalfCycle * ddq, ddq, dq, ddq, false, {}};
    }
  } else {
    const auto set = [&](Part& part, const Vector3& velocity, const Vector3& acceleration) {
      part.v = velocity - kHalfCycle * acceleration;
      part.a = acceleration;
      part.velocity = velocity;
      part.acceleration = acceleration;
      part.held = false;
    };
    m.position = from.cartesian.position;
    m.orientation = from.cartesian.orientation.normalized();
    set(m.translation, from.cartesian.velocity.head<3>(), from.cartesian.acceleration.head<3>());
    set(m.rotation, from.cartesian.velocity.tail<3>(), from.cartesian.acceleration.tail<3>());
  }
  m.before = m;
  return false;
}

void Limiter::joints_follow(const JointsOfPose& joints, const JointsOfPose& ahead, bool robots) noexcept {
  Impl& m = *impl_;
  m.along_robots = robots;
  m.along = joints;
  m.along_change = (ahead.dq_dP - joints.dq_dP) / m.ahead;
  const double here = joints.determinant, there = ahead.determinant;
  m.along_determinant = std::abs(here);
  m.along_nearing = (m.along_determinant - std::copysign(there, here * there)) / m.ahead;
  if (m.has_along) return;
  m.has_along = true;
  m.along_v = joints.dq_dP * twist(m.translation.v, m.rotation.v);
  m.along_a = joints.dq_dP * twist(m.translation.a, m.rotation.a);
  m.look_ahead();
}

bool Limiter::has_room() noexcept {
  if (impl_->along_robots && impl_->along_determinant < kLeastDeterminant) return false;
  const auto on = [](const Part& part) { return Impl::PartStep{kTick * part.velocity, part.velocity, Vector3::Zero()}; };
  return impl_->along_admissible(on(impl_->translation), on(impl_->rotation), kTick);
}

Vector7 Limiter::joints_ahead(const Vector7& q) const noexcept {
  const Impl& m = *impl_;
  return m.has_along ? Vector7(q + m.ahead * m.along_v) : q;
}

bool Limiter::follow(const Reference& wanted, double dt, Reference& out, bool straight) noexcept {
  Impl& m = *impl_;
  m.before = m;
  if (wanted.motion != m.motion || !is_valid(wanted)) {
    brake(dt, out);
    return true;
  }
  if (m.is_singular()) {
    brake(dt, out);
    m.watch(true);
    return true;
  }
  out.motion = m.motion;
  const bool held = m.motion == Channels::kJoint ? m.follow(wanted.joint, dt, straight, out.joint)
                                                 : m.follow(wanted.cartesian, dt, straight, out.cartesian);
  m.last = out;
  m.watch(held);
  return held;
}

bool Limiter::brake(double dt, Reference& out, bool soon) noexcept {
  Impl& m = *impl_;
  m.before = m;
  m.again = false;
  if (m.motion == Channels::kJoint) {
    std::array<Step, kJoints> steps;
    m.brake_steps(dt, steps, soon);
    for (int i = 0; i < kJoints; ++i) {
      m.take(m.joints[i], m.joints[i].q + steps[i].delta, steps[i], dt);
      m.joints[i].held = !m.joints[i].rests();  // from rest there is nothing to catch up with
    }
  } else {
    Impl::PartStep linear, angular;
    m.brake_steps(dt, linear, angular, soon);
    m.move(linear, angular, dt);
    m.translation.held = !m.translation.rests();
    m.rotation.held = !m.rotation.rests();
  }
  m.write(m.motion, out);
  m.last = out;
  return at_rest();
}

void Limiter::take_back() noexcept {
  static_cast<Motion&>(*impl_) = impl_->before;
  impl_->again = true;
}

std::size_t Limiter::way_to_rest(std::span<Vector7> out, bool soon) noexcept {
  Impl& m = *impl_;
  Vector7 q;
  for (int i = 0; i < kJoints; ++i) q[i] = m.joints[i].q;
  out[0] = q;
  if (!m.plan_brake(soon)) return 1;
  std::array<double, kJoints> p, v, a;
  const double duration = m.joint_brake.trajectory.get_duration();
  m.joint_brake.trajectory.at_time(duration, p, v, a);
  const double most = Vector7::Map(p.data()).cwiseAbs().maxCoeff();
  const std::size_t count = places_on(most, out.size());
  for (std::size_t k = 0; k < count; ++k) {
    // As far from each other where it is fast as where it is slow.
    const double left = 1 - static_cast<double>(k + 1) / static_cast<double>(count);
    m.joint_brake.trajectory.at_time(duration * (1 - std::sqrt(left)), p, v, a);
    out[k] = q + Vector7::Map(p.data());
  }
  return count;
}

std::size_t Limiter::way_to_rest(std::span<Vector6> out) const noexcept {
  const Impl& m = *impl_;
  const Vector6 v = twist(m.translation.velocity, m.rotation.velocity);
  const Vector6 a = twist(m.translation.acceleration, m.rotation.acceleration);
  // On as now until the stop decelerates, then to rest at a constant rate.
  const Vector6 way = kAlongDelay * (v + kAlongDelay / 2 * a) + m.stop_time(v.head<3>(), v.tail<3>()) / 2 * v;
  const std::size_t count = places_on(way.cwiseAbs().maxCoeff(), out.size());
  for (std::size_t k = 0; k < count; ++k) out[k] = static_cast<double>(k + 1) / static_cast<double>(count) * way;
  return count;
}

void Limiter::coast(double dt, Reference& out) noexcept {
  Impl& m = *impl_;
  m.coast(m.motion, dt);
  if (m.in_doubt) m.doubt.coast(m.motion, dt);
  m.write(m.motion, out);
  m.last = out;
}

// The loss of one output is often less than the rounding; that of the next shows both.
bool Limiter::reconcile(const Reference& robots, int cycles, double rounding, double dt, Reference& out) noexcept {
  Impl& m = *impl_;
  const auto error_of = [&](Motion each) {
    for (int n = 1; n < cycles; ++n) each.coast(m.motion, dt);
    return each.difference(robots);
  };
  Motion lost = m.before;
  lost.coast(m.motion, dt);
  double error = error_of(lost);
  if (m.in_doubt) {
    m.doubt.coast(m.motion, dt);
    if (const double other = error_of(m.doubt); other < error) {
      lost = m.doubt;
      error = other;
    }
  }
  const double sent = error_of(m);
  const bool certain = sent > error + rounding, possible = error < rounding;
  const bool stray = !possible && sent > kStray;
  m.in_doubt = possible && !certain;
  m.doubt = lost;
  if (stray) {
    m.adopt(robots, cycles, rounding, dt);
  } else if (possible && certain) {
    static_cast<Motion&>(m) = lost;
  } else {
    return false;
  }
  m.write(m.motion, out);
  m.last = out;
  return true;
}

const Reference& Limiter::last() const noexcept { return impl_->last; }

bool Limiter::stuck() const noexcept { return impl_->stuck_cycles >= kStuckCycles; }

bool Limiter::at_rest() const noexcept {
  const Impl& m = *impl_;
  if (m.motion != Channels::kJoint) return m.translation.rests() && m.rotation.rests();
  return std::all_of(m.joints.begin(), m.joints.end(), [](const Joint& joint) { return joint.rests(); });
}

TorqueLimiter::TorqueLimiter(const models::Limits& limits)
    : tau_max_(kShare * Vector7::Map(limits.tau_max.data())),
      dtau_max_(kShare * Vector7::Map(limits.dtau_max.data())),
      least_(-tau_max_),
      most_(tau_max_) {}

void TorqueLimiter::beside(const Vector7& borne) noexcept {
  least_ = (-tau_max_).cwiseMax(-tau_max_ - borne).cwiseMin(0);
  most_ = tau_max_.cwiseMin(tau_max_ - borne).cwiseMax(0);
}

double TorqueLimiter::share_inside(const Vector7& from, const Vector7& to) const noexcept {
  double share = 1;
  for (int i = 0; i < kJoints; ++i) {
    const double way = to[i] - from[i], room = way > 0 ? most_[i] - from[i] : from[i] - least_[i];
    if (room < share * std::abs(way)) share = std::max(room, 0.) / std::abs(way);
  }
  return share;
}

bool TorqueLimiter::scale(const Vector7& wanted, const Vector7& last, double dt, Vector7& out) const noexcept {
  const bool finite = wanted.allFinite();
  const Vector7 target = finite ? Vector7(wanted / std::max(share(wanted), 1.)) : Vector7::Zero();
  const Vector7 change = target - last;
  const double rate = change.cwiseAbs().cwiseQuotient(dt * dtau_max_).maxCoeff();
  out = last + change / std::max(rate, 1.);
  return !finite || rate > 1 || share(wanted) > 1;
}

bool TorqueLimiter::limit(const Vector7& wanted, const Vector7& last, double dt, Vector7& out) const noexcept {
  bool held = false;
  for (int i = 0; i < kJoints; ++i) {
    const double asked = wanted[i];  // which `out` may be
    const double target = std::isfinite(asked) ? std::clamp(asked, least_[i], most_[i]) : 0;
    const double rate = dt * dtau_max_[i];
    out[i] = std::clamp(target, last[i] - rate, last[i] + rate);
    held |= out[i] != asked;
  }
  return held;
}

}  // namespace realtime
