#include "sim/robot/checks.hpp"

#include <cmath>

#include "models/joint_figures.hpp"
#include "sim/robot/dt.hpp"
#include "sim/robot/rotation.hpp"
#include "sim/robot/transform.hpp"

namespace sim {
namespace {

using fci::Error;
using fci::Errors;
using Mode = fci::MotionGeneratorMode;

// From system 5.7.2 on, errors 12 and 27 stay false: `joint_position_limits_violation` replaces them (libfranka's changelog,
// 0.15.0).
constexpr fci::Version kOneRangeErrorVersion = 9;

// From the same system on, libfranka's examples begin a motion at the measured `q`, `O_T_EE` and `elbow`, which differ from
// what is desired (changelog, 0.15.0).
constexpr fci::Version kMeasuredStartVersion = 9;

// Not published by Franka; docs/simulated-arm.md has the reasons.
constexpr double kStartJoint = 0.1;         // rad, between q_d and the first q_c
constexpr double kStartTranslation = 0.05;  // m, between O_T_EE_c and the first pose
constexpr double kStartRotation = 0.2;      // rad
constexpr double kStartElbow = 0.1;         // rad
constexpr double kBeginAngle = 0.005;        // rad, of each joint, of a pose and of an elbow beside which a motion may begin
constexpr double kBeginTranslation = 0.002;  // m
constexpr double kRestVelocity = 0.1;       // rad/s, from which on an arm under torque control still moves
constexpr double kPositionMargin = 0.01;    // rad, of measured joints beyond their range
constexpr double kLeaving = 0.01;           // rad/s, outwards
constexpr double kVelocityMargin = 0.1;     // of the limit, for measured velocities
constexpr double kTauJRange = 1.1;          // of tau_max
constexpr double kClosingIn = 1e-5;         // m each cycle
constexpr double kTorqueRounding = 4e-6;    // N m: half a unit in the last place of a float32 near tau_max
constexpr double kDoubleRounding = 1e-13;   // rad and m: what differences of doubles are good for

template <class Values>
bool finite(const Values& values) {
  for (double value : values) {
    if (!std::isfinite(value)) return false;
  }
  return true;
}

void raise(Errors& errors, Error error, bool broken) {
  if (broken) errors[static_cast<std::size_t>(error)] = true;
}

struct RateErrors {
  Error velocity, acceleration, jerk;
};
constexpr RateErrors kJointErrors = {Error::kJointVelocityLimitsCommanded, Error::kJointVelocityDiscontinuity,
                                     Error::kJointAccelerationDiscontinuity};
constexpr RateErrors kCartesianErrors = {Error::kCartesianVelocityLimits, Error::kCartesianVelocityDiscontinuity,
                                         Error::kCartesianAccelerationDiscontinuity};
constexpr RateErrors kCartesianJointErrors = {Error::kCartesianJointVelocityLimits,
                                              Error::kCartesianJointVelocityDiscontinuity,
                                              Error::kCartesianJointAccelerationDiscontinuity};

// Magnitudes against limits; NaN breaks them.
void rates(Errors& errors, const RateErrors& names, double velocity, double acceleration, double jerk,
           const models::Limits::Rates& limits, double rounding) {
  raise(errors, names.velocity, !(velocity <= limits.velocity + rounding / kDt));
  raise(errors, names.acceleration, !(acceleration <= limits.acceleration + rounding / (kDt * kDt)));
  raise(errors, names.jerk, !(jerk <= limits.jerk + rounding / (kDt * kDt * kDt)));
}

double angle_between(const Eigen::Matrix4d& a, const Eigen::Matrix4d& b) {
  return rotation_between(a.topLeftCorner<3, 3>(), b.topLeftCorner<3, 3>()).norm();
}
double distance_between(const Eigen::Matrix4d& a, const Eigen::Matrix4d& b) {
  return (a.topRightCorner<3, 1>() - b.topRightCorner<3, 1>()).norm();
}
bool beyond(const fci::Deviation& most, const Eigen::Matrix4d& pose, double q3, const Eigen::Matrix4d& wanted_pose,
            double wanted_q3) {
  return distance_between(pose, wanted_pose) > most.translation ||
         (most.rotation < M_PI && angle_between(pose, wanted_pose) > most.rotation) ||
         std::abs(q3 - wanted_q3) > most.elbow;
}

}  // namespace

Checks::Checks(const models::Arm& arm) : arm_(arm), self_(arm), walls_(arm) { set_version(fci::kNewestVersion); }

void Checks::set_version(fci::Version version) {
  limits_ = &models::limits(arm_, version);
  const bool single = version >= fci::kFloatStateVersion;
  q_rounding_ = single ? 0x1p-23 : kDoubleRounding;
  p_rounding_ = single ? 0x1p-23 : kDoubleRounding;
  begins_beside_ = version >= kMeasuredStartVersion;
  const bool one_name = version >= kOneRangeErrorVersion;
  joint_range_ = one_name ? Error::kJointPositionLimits : Error::kJointPositionLimitsCommanded;
  cartesian_range_ = one_name ? Error::kJointPositionLimits : Error::kCartesianJointPositionLimits;
}

void Checks::start(const fci::Move& request, const ArmModel& at) {
  motion_ = request;
  distance_ = self_.distance(at, models::kCapsuleMargin);
  wall_distance_ = walls_.distance(at);
}

// Where the arm is in it already, it only must not go deeper.
void Checks::set_wall(int id, const VirtualWall& wall, const ArmModel& at) {
  walls_.set(id, wall);
  wall_distance_ = walls_.distance(at);
}

bool Checks::joints() const {
  return motion_.motion_generator_mode == Mode::kJointPosition || motion_.motion_generator_mode == Mode::kJointVelocity;
}
bool Checks::cartesian() const {
  return motion_.motion_generator_mode == Mode::kCartesianPosition ||
         motion_.motion_generator_mode == Mode::kCartesianVelocity;
}

std::optional<Error> Checks::values(const fci::RobotCommand& command) const {
  switch (motion_.motion_generator_mode) {
    case Mode::kJointPosition:
      if (!finite(command.q_c)) return joint_range_;
      break;
    case Mode::kJointVelocity:
      if (!finite(command.dq_c)) return Error::kJointVelocityLimitsCommanded;
      break;
    case Mode::kCartesianPosition:
      if (!is_transform(command.O_T_EE_c)) return Error::kCartesianInvalidFrame;
      break;
    case Mode::kCartesianVelocity:
      if (!finite(command.O_dP_EE_c)) return Error::kCartesianVelocityLimits;
      break;
    default:
      break;
  }
  if (cartesian() && command.valid_elbow && !finite(command.elbow_c)) return Error::kCartesianElbowLimit;
  if (torques() && !finite(command.tau_J_d)) return Error::kControllerTorqueDiscontinuity;
  return std::nullopt;
}

bool Checks::possible(const fci::Vector7& maximum_velocity) const {
  for (int i = 0; i < models::kJoints; ++i) {
    if (!(maximum_velocity[i] > 0 && maximum_velocity[i] <= limits_->dq_max[i])) return false;
  }
  return true;
}

Errors Checks::target(const Vector7& q) const {
  Errors errors{};
  for (int i = 0; i < models::kJoints; ++i) {
    const bool inside = q[i] >= limits_->q_min[i] && q[i] <= limits_->q_max[i];
    raise(errors, joint_range_,
          !(inside && limits_->dq_upper(i, q[i]) > 0 && limits_->dq_lower(i, q[i]) < 0));
  }
  return errors;
}

Errors Checks::first(const fci::RobotCommand& command, const Desired& at) const {
  Errors errors{};
  if (motion_.motion_generator_mode == Mode::kJointPosition) {
    const double jump = (Vector7::Map(command.q_c.data()) - at.q).cwiseAbs().maxCoeff();
    raise(errors, Error::kJointStartPoseInvalid, jump > kStartJoint);
  } else if (motion_.motion_generator_mode == Mode::kCartesianPosition) {
    const Eigen::Matrix4d pose = matrix(command.O_T_EE_c);
    raise(errors, Error::kCartesianStartPoseInvalid,
          distance_between(pose, at.O_T_EE_c) > kStartTranslation || angle_between(pose, at.O_T_EE_c) > kStartRotation);
  }
  if (cartesian() && command.valid_elbow) {
    raise(errors, Error::kCartesianStartElbowInvalid, std::abs(command.elbow_c[0] - at.elbow_c[0]) > kStartElbow);
    raise(errors, Error::kCartesianElbowSignInconsistent, command.elbow_c[1] != at.elbow_c[1]);
  }
  return errors;
}

bool Checks::begins(const fci::RobotCommand& command, const Desired& at) const {
  if (!begins_beside_) return false;
  if (motion_.motion_generator_mode == Mode::kJointPosition) {
    return (Vector7::Map(command.q_c.data()) - at.q).cwiseAbs().maxCoeff() <= kBeginAngle;
  }
  return motion_.motion_generator_mode == Mode::kCartesianPosition &&
         !beyond({kBeginTranslation, kBeginAngle, kBeginAngle}, matrix(command.O_T_EE_c),
                 command.valid_elbow ? command.elbow_c[0] : at.elbow_c[0], at.O_T_EE_c, at.elbow_c[0]);
}

Errors Checks::elbow(const fci::RobotCommand& command, const Desired& before) const {
  Errors errors{};
  if (!cartesian() || !command.valid_elbow) return errors;
  raise(errors, Error::kCartesianElbowLimit,
        command.elbow_c[0] > limits_->q_max[2] || command.elbow_c[0] < limits_->q_min[2]);
  raise(errors, Error::kCartesianElbowSignInconsistent, command.elbow_c[1] != before.elbow_c[1]);
  return errors;
}

Errors Checks::reference(const Desired& before, const Desired& after) const {
  Errors errors{};
  if (!joints() && !cartesian()) return errors;
  if (cartesian()) {
    const auto norms = [&](const auto& vector, int from) { return vector.template segment<3>(from).norm(); };
    const auto jerk = ((after.O_ddP_EE_c - before.O_ddP_EE_c) / kDt).eval();
    for (const auto& [from, limits, rounding] :
         {std::tuple{0, &limits_->translation, p_rounding_}, std::tuple{3, &limits_->rotation, q_rounding_}}) {
      rates(errors, kCartesianErrors, norms(after.O_dP_EE_c, from), norms(after.O_ddP_EE_c, from), norms(jerk, from),
            *limits, rounding);
    }
    rates(errors, kCartesianErrors, std::abs(after.delbow_c[0]), std::abs(after.ddelbow_c[0]),
          std::abs(after.ddelbow_c[0] - before.ddelbow_c[0]) / kDt, limits_->elbow, q_rounding_);
    if (fci::any(errors)) return errors;
  }
  const RateErrors& names = cartesian() ? kCartesianJointErrors : kJointErrors;
  const Error position = cartesian() ? cartesian_range_ : joint_range_;
  for (int i = 0; i < models::kJoints; ++i) {
    const double q = after.q[i], dq = after.dq[i];
    const double rounding = std::abs(q) < 4 ? q_rounding_ : 2 * q_rounding_;  // only joint 6 of an FR3 goes there
    // From beyond its range the way back is open.
    const double beyond = std::max(q - limits_->q_max[i], limits_->q_min[i] - q);
    const double beyond_before = std::max(before.q[i] - limits_->q_max[i], limits_->q_min[i] - before.q[i]);
    raise(errors, position, !(beyond <= rounding + std::max(beyond_before, 0.)));
    const double dq_max = dq > 0 ? limits_->dq_upper(i, before.q[i]) : -limits_->dq_lower(i, before.q[i]);
    rates(errors, names, std::abs(dq), std::abs(after.ddq[i]), std::abs(after.ddq[i] - before.ddq[i]) / kDt,
          {dq_max, limits_->ddq_max[i], limits_->dddq_max[i]}, rounding);
  }
  return errors;
}

Errors Checks::torque(const Vector7& tau, const Vector7& before) const {
  Errors errors{};
  for (int i = 0; i < models::kJoints; ++i) {
    raise(errors, Error::kControllerTorqueDiscontinuity,
          !(std::abs(tau[i] - before[i]) <= limits_->dtau_max[i] * kDt + kTorqueRounding));
  }
  return errors;
}

Errors Checks::finish(const Desired& desired, const Vector7& dq, const Eigen::Matrix4d& O_T_EE,
                      const Vector7& q) const {
  Errors errors{};
  if (joints() || cartesian()) {
    Desired stopped = desired;
    stopped.dq.setZero();
    stopped.ddq = -desired.dq / kDt;
    stopped.O_dP_EE_c.setZero();
    stopped.O_ddP_EE_c = -desired.O_dP_EE_c / kDt;
    stopped.delbow_c[0] = 0;
    stopped.ddelbow_c[0] = -desired.delbow_c[0] / kDt;
    // Under torques the reference moves no joint; libfranka 0.13.1 and 0.13.2 let it follow the measured ones to the end.
    if (!torques()) errors = reference(desired, stopped);
    raise(errors, Error::kMaxGoalPoseDeviation,
          !torques() && beyond(motion_.maximum_goal_pose_deviation, O_T_EE, q[2], desired.O_T_EE_c, desired.elbow_c[0]));
  }
  raise(errors, Error::kJointVelocityDiscontinuity, torques() && dq.cwiseAbs().maxCoeff() > kRestVelocity);
  return errors;
}

Errors Checks::arm(const ArmModel& model, const Eigen::Matrix4d& F_T_EE, const Vector7& q, const Vector7& dq,
                   const Vector7& tau_J, const Vector7& tau_motor, const Desired& desired) const {
  Errors errors{};
  raise(errors, Error::kJointPositionLimits, leaves_range(q, dq));
  for (int i = 0; i < models::kJoints; ++i) {
    const double slack = kVelocityMargin * limits_->dq_max[i];
    raise(errors, Error::kJointVelocity,
          dq[i] > limits_->dq_upper(i, q[i]) + slack || dq[i] < limits_->dq_lower(i, q[i]) - slack);
    raise(errors, Error::kTauJRange, !(std::abs(tau_J[i]) <= kTauJRange * limits_->tau_max[i]));
  }
  const Eigen::Matrix4d O_T_EE = model.O_T_F() * F_T_EE;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
  for (int i = 0; i < models::kJoints; ++i) {
    velocity += dq[i] * model.O_R(i + 1).col(2).cross(O_T_EE.topRightCorner<3, 1>() - model.O_p(i + 1));
  }
  raise(errors, Error::kCartesianVelocity, velocity.norm() > (1 + kVelocityMargin) * limits_->translation.velocity);
  raise(errors, Error::kPowerLimit, tau_motor.cwiseProduct(dq).cwiseMax(0).sum() > models::kMostPower);
  if ((joints() || cartesian()) && !torques()) {
    raise(errors, Error::kMaxPathPoseDeviation,
          beyond(motion_.maximum_path_deviation, O_T_EE, q[2], desired.O_T_EE_c, desired.elbow_c[0]));
  }
  return errors;
}

bool Checks::inside_range(const Vector7& q) const {
  return ((q - Vector7::Map(limits_->q_min.data())).array() >= -kPositionMargin).all() &&
         ((Vector7::Map(limits_->q_max.data()) - q).array() >= -kPositionMargin).all();
}

bool Checks::leaves_range(const Vector7& q, const Vector7& dq) const {
  for (int i = 0; i < models::kJoints; ++i) {
    if (q[i] > limits_->q_max[i] + kPositionMargin && dq[i] > kLeaving) return true;
    if (q[i] < limits_->q_min[i] - kPositionMargin && dq[i] < -kLeaving) return true;
  }
  return false;
}

Errors Checks::collision(const ArmModel& at) {
  Errors errors{};
  const double distance = self_.distance(at, models::kCapsuleMargin);
  raise(errors, Error::kSelfCollisionAvoidance, distance < models::kCapsuleMargin && distance < distance_ - kClosingIn);
  distance_ = distance;
  const double wall_distance = walls_.distance(at);
  raise(errors, Error::kCartesianPositionLimits, wall_distance < 0 && wall_distance < wall_distance_ - kClosingIn);
  wall_distance_ = wall_distance;
  return errors;
}

}  // namespace sim
