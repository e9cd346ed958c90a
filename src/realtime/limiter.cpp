#include "realtime/limiter.hpp"

#include <algorithm>
#include <cmath>
#include <ruckig/ruckig.hpp>

#include "realtime/rotation.hpp"

namespace realtime {
namespace {

constexpr int kJoints = 7;

// Share of each limit that leaves this room: the rest is for rounding on the wire and in the robot.
constexpr double kShare = 0.98;
// Share that a motion which catches up is planned with; the difference keeps it clear of the checks.
constexpr double kPlanShare = 0.96;
// Least share of a velocity or acceleration limit that catching up may use for itself.
constexpr double kLeastShare = 0.05;
// Left between a braking motion and FR3's velocity envelope, rad/s: a backward difference over 1 ms lags
// by a quarter of it at most.
constexpr double kEnvelopeSlack = 0.02;
// A motion slower than this is rest; rad/s or m/s, and rad/s² or m/s².
constexpr double kRestVelocity = 1e-6;
constexpr double kRestAcceleration = 1e-3;
constexpr double kRounding = 1 + 1e-6;

// Of one coordinate: the step to the next output, and velocity and acceleration at its end.
struct Step {
  double delta, velocity, acceleration;
};

// The motion within one cycle of constant jerk.
Step constant_jerk(double velocity, double acceleration, double jerk, double dt) {
  return {dt * (velocity + dt * (acceleration / 2 + dt * jerk / 6)), velocity + dt * (acceleration + dt * jerk / 2),
          acceleration + dt * jerk};
}

template <std::size_t N>
struct Planner {
  ruckig::Ruckig<N> ruckig;
  ruckig::InputParameter<N> in;
  ruckig::Trajectory<N> trajectory;

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

  bool plan() noexcept { return ruckig.calculate(in, trajectory) == ruckig::Result::Working; }

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

bool is_valid(const Reference& reference) {
  if (reference.kind == ReferenceKind::kJoint) {
    const JointReference& joint = reference.joint;
    return joint.q.allFinite() && joint.dq.allFinite() && joint.ddq.allFinite();
  }
  const CartesianReference& pose = reference.cartesian;
  return pose.position.allFinite() && std::abs(pose.orientation.norm() - 1) < 1e-6 && pose.velocity.allFinite() &&
         pose.acceleration.allFinite();
}

Vector3 limited(const Vector3& x, double length) {
  const double norm = x.norm();
  return norm > length ? Vector3(x * (length / norm)) : x;
}

}  // namespace

struct Limiter::Impl {
  models::Limits limits;
  ReferenceKind kind = ReferenceKind::kJoint;
  Reference last;  // output

  // One joint. v and a are backward differences of the outputs, as the robot sees them; velocity and
  // acceleration are those of the motion at the last output.
  struct Joint {
    double q = 0, v = 0, a = 0;
    double velocity = 0, acceleration = 0;
    bool held = false;  // it has not caught up yet
  };
  std::array<Joint, kJoints> joints{};

  // Translation or rotation: as Joint, in the axes of O.
  struct Part {
    models::Limits::Rates limits{};
    Vector3 v = Vector3::Zero(), a = Vector3::Zero();
    Vector3 velocity = Vector3::Zero(), acceleration = Vector3::Zero();
    bool held = false;
  };
  Part translation, rotation;
  Vector3 position = Vector3::Zero();
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();

  Planner<kJoints> joint_follow, joint_brake;
  Planner<3> part_follow;
  Planner<1> stop;

  explicit Impl(const models::Limits& of) : limits(of) {
    translation.limits = limits.translation;
    rotation.limits = limits.rotation;
    joint_brake.in.control_interface = ruckig::ControlInterface::Velocity;
    stop.in.control_interface = ruckig::ControlInterface::Velocity;
    for (int i = 0; i < kJoints; ++i) {
      joint_follow.in.max_jerk[i] = kPlanShare * limits.dddq_max[i];
      joint_brake.in.max_jerk[i] = kShare * limits.dddq_max[i];
      joint_brake.in.max_acceleration[i] = kShare * limits.ddq_max[i];
      (*joint_brake.in.min_acceleration)[i] = -kShare * limits.ddq_max[i];
    }
  }

  // --- joints ---------------------------------------------------------------------------------

  // From there the joint can brake to rest without leaving its range or its velocity envelope.
  bool can_stop(int i, double q, double velocity, double acceleration) noexcept {
    // Seen in the direction of motion towards the limit: the mirror image serves the other one.
    const double A = kShare * limits.ddq_max[i];
    const double J = kShare * limits.dddq_max[i];
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
        up <= kShare * limits.dq_upper(i, q_up) - kEnvelopeSlack &&
        -down >= kShare * limits.dq_lower(i, q_down) + kEnvelopeSlack) {
      return true;
    }

    stop.in.current_position[0] = q;
    stop.in.current_velocity[0] = velocity;
    stop.in.current_acceleration[0] = acceleration;
    stop.in.max_acceleration[0] = A;
    (*stop.in.min_acceleration)[0] = -A;
    stop.in.max_jerk[0] = J;
    if (!stop.plan()) return false;
    constexpr int kSamples = 16;
    for (int k = 0; k <= kSamples; ++k) {
      std::array<double, 1> p, v, a;
      stop.trajectory.at_time(stop.trajectory.get_duration() * k / kSamples, p, v, a);
      if (p[0] > std::max(limits.q_max[i], q) || p[0] < std::min(limits.q_min[i], q)) return false;
      if (v[0] > kEnvelopeSlack / 100 && v[0] > kShare * limits.dq_upper(i, p[0]) - kEnvelopeSlack) {
        return false;
      }
      if (v[0] < -kEnvelopeSlack / 100 && v[0] < kShare * limits.dq_lower(i, p[0]) + kEnvelopeSlack) {
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
    return can_stop(i, q, step.velocity, step.acceleration);
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

  void brake_steps(double dt, std::array<Step, kJoints>& steps) noexcept {
    for (int i = 0; i < kJoints; ++i) {
      joint_brake.in.current_velocity[i] = joints[i].velocity;
      joint_brake.in.current_acceleration[i] = joints[i].acceleration;
    }
    if (joint_brake.plan()) {
      joint_brake.step(dt, steps);
      return;
    }
    for (int i = 0; i < kJoints; ++i) {  // at least no acceleration
      const double J = kShare * limits.dddq_max[i];
      steps[i] = constant_jerk(joints[i].velocity, joints[i].acceleration,
                               std::clamp(-joints[i].acceleration / dt, -J, J), dt);
    }
  }

  // Plans in coordinates relative to what is wanted, which moves on: there the goal is rest at zero, and
  // the limits leave room for the wanted motion.
  bool follow_steps(const JointReference& wanted, double dt, std::array<Step, kJoints>& steps) noexcept {
    auto& in = joint_follow.in;
    Vector7 velocity, acceleration;
    for (int i = 0; i < kJoints; ++i) {
      const double V = kPlanShare * limits.dq_max[i];
      const double A = kPlanShare * limits.ddq_max[i];
      const double q = std::clamp(wanted.q[i], limits.q_min[i], limits.q_max[i]);
      const bool inside = q == wanted.q[i];
      velocity[i] = inside ? std::clamp(wanted.dq[i], -V, V) : 0;
      acceleration[i] = inside ? std::clamp(wanted.ddq[i], -A, A) : 0;
      // Where `wanted` was at the last output, if it moved as it says.
      const double before = q - dt * (velocity[i] - dt * acceleration[i] / 2);
      in.current_position[i] = joints[i].q - before;
      in.current_velocity[i] = joints[i].velocity - (velocity[i] - dt * acceleration[i]);
      in.current_acceleration[i] = joints[i].acceleration - acceleration[i];
      const double upper = std::min(V, kPlanShare * limits.dq_upper(i, joints[i].q));
      const double lower = std::max(-V, kPlanShare * limits.dq_lower(i, joints[i].q));
      in.max_velocity[i] = std::max(upper - velocity[i], kLeastShare * V);
      (*in.min_velocity)[i] = std::min(lower - velocity[i], -kLeastShare * V);
      in.max_acceleration[i] = std::max(A - acceleration[i], kLeastShare * A);
      (*in.min_acceleration)[i] = std::min(-A - acceleration[i], -kLeastShare * A);
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

  void write(JointReference& out) const {
    for (int i = 0; i < kJoints; ++i) {
      out.q[i] = joints[i].q;
      out.dq[i] = joints[i].velocity;
      out.ddq[i] = joints[i].acceleration;
    }
  }

  bool follow(const JointReference& wanted, double dt, JointReference& out) noexcept {
    std::array<bool, kJoints> pass;
    bool all = true;
    for (int i = 0; i < kJoints; ++i) {
      pass[i] = std::abs(wanted.dq[i]) <= limits.dq_max[i] && std::abs(wanted.ddq[i]) <= limits.ddq_max[i] &&
                admissible(i, as_wanted(joints[i], wanted.q[i], dt), dt);
      all &= pass[i] && !joints[i].held;
    }
    std::array<Step, kJoints> follow, brake;
    bool has_follow = false, has_brake = false;
    if (!all) has_follow = follow_steps(wanted, dt, follow);
    std::array<Joint, kJoints> next = joints;
    all = true;
    for (int i = 0; i < kJoints; ++i) {
      // A joint on its way may meet the wanted position in passing: that is not yet to have caught up.
      if (joints[i].held) pass[i] = pass[i] && has_follow && joint_follow.arrives(i, dt);
      next[i].held = !pass[i];
      all &= pass[i];
      if (pass[i]) {
        take(next[i], wanted.q[i], as_wanted(joints[i], wanted.q[i], dt), dt);
      } else if (has_follow && admissible(i, follow[i], dt)) {
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

  // As for joints, with per-axis limits that keep the norms.
  bool follow_step(const Part& part, const Vector3& delta, const Vector3& wanted_velocity,
                   const Vector3& wanted_acceleration, double dt, PartStep& step) noexcept {
    const double V = kPlanShare * part.limits.velocity;
    const double A = kPlanShare * part.limits.acceleration;
    const double J = kPlanShare * part.limits.jerk;
    const Vector3 velocity = limited(wanted_velocity, V);
    const Vector3 acceleration = limited(wanted_acceleration, A);
    const double axis = 1 / std::sqrt(3.0);
    const double V_axis = axis * std::max(V - velocity.norm(), kLeastShare * V);
    const double A_axis = axis * std::max(A - acceleration.norm(), kLeastShare * A);
    const Vector3 moved = dt * (velocity - dt / 2 * acceleration);
    auto& in = part_follow.in;
    for (int i = 0; i < 3; ++i) {
      in.current_position[i] = moved[i] - delta[i];
      in.current_velocity[i] = part.velocity[i] - (velocity[i] - dt * acceleration[i]);
      in.current_acceleration[i] = part.acceleration[i] - acceleration[i];
      in.max_velocity[i] = V_axis;
      (*in.min_velocity)[i] = -V_axis;
      in.max_acceleration[i] = A_axis;
      (*in.min_acceleration)[i] = -A_axis;
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

  // Acceleration to zero, then straight back along the velocity: both keep the norms.
  PartStep brake_step(const Part& part, double dt) noexcept {
    const double A = kShare * part.limits.acceleration;
    const double J = kShare * part.limits.jerk;
    const double speed = part.velocity.norm();
    const double pull = part.acceleration.norm();
    if (speed == 0 && pull == 0) return {Vector3::Zero(), Vector3::Zero(), Vector3::Zero()};
    const Vector3 along = speed > 0 ? Vector3(part.velocity / speed) : Vector3(part.acceleration / pull);
    const double a = part.acceleration.dot(along);
    if ((part.acceleration - a * along).norm() <= 1e-3 * J * dt) {
      stop.in.current_position[0] = 0;
      stop.in.current_velocity[0] = speed;
      stop.in.current_acceleration[0] = a;
      stop.in.max_acceleration[0] = A;
      (*stop.in.min_acceleration)[0] = -A;
      stop.in.max_jerk[0] = J;
      if (stop.plan()) {
        std::array<Step, 1> step;
        stop.step(dt, step);
        return {step[0].delta * along, step[0].velocity * along, step[0].acceleration * along};
      }
    }
    const Vector3 j = limited(-part.acceleration / dt, J);
    return {dt * (part.velocity + dt * (part.acceleration / 2 + dt / 6 * j)),
            part.velocity + dt * (part.acceleration + dt / 2 * j), part.acceleration + dt * j};
  }

  // Chooses the step of one part; true when it is what was wanted.
  bool choose(Part& part, const Vector3& delta, const Vector3& velocity, const Vector3& acceleration, double dt,
              PartStep& step) noexcept {
    const PartStep wanted = as_wanted(part, delta, dt);
    const bool pass = velocity.norm() <= part.limits.velocity && acceleration.norm() <= part.limits.acceleration &&
                      admissible(part, wanted, dt);
    step = wanted;
    if (pass && !part.held) return true;
    const bool has_follow = follow_step(part, delta, velocity, acceleration, dt, step);
    part.held =
        !(pass && has_follow && part_follow.arrives(0, dt) && part_follow.arrives(1, dt) && part_follow.arrives(2, dt));
    if (!part.held) {
      step = wanted;
    } else if (!has_follow || !admissible(part, step, dt)) {
      step = brake_step(part, dt);
    }
    return !part.held;
  }

  void write(CartesianReference& out) const {
    out.position = position;
    out.orientation = orientation;
    out.velocity << translation.velocity, rotation.velocity;
    out.acceleration << translation.acceleration, rotation.acceleration;
  }

  void move(const PartStep& linear, const PartStep& angular, double dt) {
    take(translation, linear, dt);
    take(rotation, angular, dt);
    position += linear.delta;
    orientation = (exp(angular.delta) * orientation).normalized();
  }

  bool follow(const CartesianReference& wanted, double dt, CartesianReference& out) noexcept {
    PartStep linear, angular;
    const Vector3 turn = log(wanted.orientation * orientation.conjugate());
    const bool pass_position = choose(translation, wanted.position - position, wanted.velocity.head<3>(),
                                      wanted.acceleration.head<3>(), dt, linear);
    const bool pass_orientation =
        choose(rotation, turn, wanted.velocity.tail<3>(), wanted.acceleration.tail<3>(), dt, angular);
    move(linear, angular, dt);
    if (pass_position) position = wanted.position;
    if (pass_orientation) orientation = wanted.orientation;
    write(out);
    if (pass_position) {
      out.velocity.head<3>() = wanted.velocity.head<3>();
      out.acceleration.head<3>() = wanted.acceleration.head<3>();
    }
    if (pass_orientation) {
      out.velocity.tail<3>() = wanted.velocity.tail<3>();
      out.acceleration.tail<3>() = wanted.acceleration.tail<3>();
    }
    return !(pass_position && pass_orientation);
  }

  bool is_last(const Reference& from) const {
    if (from.kind != last.kind) return false;
    if (from.kind == ReferenceKind::kJoint) {
      return from.joint.q == last.joint.q && from.joint.dq == last.joint.dq && from.joint.ddq == last.joint.ddq;
    }
    const CartesianReference &a = from.cartesian, &b = last.cartesian;
    return a.position == b.position && a.orientation.coeffs() == b.orientation.coeffs() && a.velocity == b.velocity &&
           a.acceleration == b.acceleration;
  }

  void write(Reference& out) const {
    out.kind = kind;
    if (kind == ReferenceKind::kJoint) {
      write(out.joint);
    } else {
      write(out.cartesian);
    }
  }
};

Limiter::Limiter(const models::Limits& limits) : impl_(std::make_unique<Impl>(limits)) {}
Limiter::~Limiter() = default;

void Limiter::reset(const Reference& from) noexcept {
  // As if the outputs before had come with constant acceleration: differences lag by half a cycle.
  constexpr double kHalfCycle = 0.0005;  // s
  Impl& m = *impl_;
  if (m.is_last(from)) return;  // and the differences are known
  m.last = from;
  m.kind = from.kind;
  if (from.kind == ReferenceKind::kJoint) {
    for (int i = 0; i < kJoints; ++i) {
      const double dq = from.joint.dq[i], ddq = from.joint.ddq[i];
      m.joints[i] = {from.joint.q[i], dq - kHalfCycle * ddq, ddq, dq, ddq, false};
    }
  } else {
    const auto set = [&](Impl::Part& part, const Vector3& velocity, const Vector3& acceleration) {
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
}

bool Limiter::follow(const Reference& wanted, double dt, Reference& out) noexcept {
  Impl& m = *impl_;
  if (wanted.kind != m.kind || !is_valid(wanted)) {
    brake(dt, out);
    return true;
  }
  out.kind = m.kind;
  const bool held = m.kind == ReferenceKind::kJoint ? m.follow(wanted.joint, dt, out.joint)
                                                    : m.follow(wanted.cartesian, dt, out.cartesian);
  m.last = out;
  return held;
}

bool Limiter::brake(double dt, Reference& out) noexcept {
  Impl& m = *impl_;
  if (m.kind == ReferenceKind::kJoint) {
    std::array<Step, kJoints> steps;
    m.brake_steps(dt, steps);
    for (int i = 0; i < kJoints; ++i) {
      m.take(m.joints[i], m.joints[i].q + steps[i].delta, steps[i], dt);
      m.joints[i].held = true;
    }
  } else {
    m.translation.held = m.rotation.held = true;
    m.move(m.brake_step(m.translation, dt), m.brake_step(m.rotation, dt), dt);
  }
  m.write(out);
  m.last = out;
  return at_rest();
}

void Limiter::coast(double dt, Reference& out) noexcept {
  Impl& m = *impl_;
  if (m.kind == ReferenceKind::kJoint) {
    for (auto& joint : m.joints) {
      joint.v += dt * joint.a;
      joint.q += dt * joint.v;
      joint.velocity = joint.v + dt / 2 * joint.a;
      joint.acceleration = joint.a;
    }
  } else {
    for (Impl::Part* part : {&m.translation, &m.rotation}) {
      part->v += dt * part->a;
      part->velocity = part->v + dt / 2 * part->a;
      part->acceleration = part->a;
    }
    m.position += dt * m.translation.v;
    m.orientation = (exp(dt * m.rotation.v) * m.orientation).normalized();
  }
  m.write(out);
  m.last = out;
}

bool Limiter::at_rest() const noexcept {
  const Impl& m = *impl_;
  if (m.kind == ReferenceKind::kJoint) {
    return std::all_of(m.joints.begin(), m.joints.end(), [](const Impl::Joint& joint) {
      return std::abs(joint.v) <= kRestVelocity && std::abs(joint.velocity) <= kRestVelocity &&
             std::abs(joint.a) <= kRestAcceleration && std::abs(joint.acceleration) <= kRestAcceleration;
    });
  }
  const auto rests = [](const Impl::Part& part) {
    return part.v.norm() <= kRestVelocity && part.velocity.norm() <= kRestVelocity &&
           part.a.norm() <= kRestAcceleration && part.acceleration.norm() <= kRestAcceleration;
  };
  return rests(m.translation) && rests(m.rotation);
}

TorqueLimiter::TorqueLimiter(const models::Limits& limits)
    : tau_max_(kShare * Vector7::Map(limits.tau_max.data())),
      dtau_max_(kShare * Vector7::Map(limits.dtau_max.data())) {}

bool TorqueLimiter::limit(const Vector7& wanted, const Vector7& last, double dt, Vector7& out) noexcept {
  bool held = false;
  for (int i = 0; i < kJoints; ++i) {
    const double target = std::isfinite(wanted[i]) ? std::clamp(wanted[i], -tau_max_[i], tau_max_[i]) : 0;
    const double rate = dt * dtau_max_[i];
    out[i] = std::clamp(target, last[i] - rate, last[i] + rate);
    held |= out[i] != wanted[i];
  }
  return held;
}

}  // namespace realtime
