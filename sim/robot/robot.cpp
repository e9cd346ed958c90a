#include "sim/robot/robot.hpp"

#include <algorithm>

#include "sim/robot/dt.hpp"
#include "sim/robot/low_pass.hpp"
#include "sim/robot/rotation.hpp"
#include "sim/robot/transform.hpp"
#include "sim/robot/vectors.hpp"

namespace sim {
namespace {

using fci::ControllerMode;
using fci::Error;
using fci::RobotMode;
using fci::Status;
using Mode = fci::MotionGeneratorMode;
using Vector = Eigen::Matrix<double, 7, 1>;
using Wrench = Eigen::Matrix<double, 6, 1>;

// Version from which on there are statuses for safety functions.
constexpr fci::Version kSafetyStatuses = 6;

// What Franka does not publish.
constexpr int kRecoveryCycles = 50;
constexpr double kAccelerating = 0.01;  // rad/s², of any joint's reference: the "acceleration" thresholds apply
constexpr double kSwinging = 0.01;      // rad/s, of an arm that a reflex has not yet brought to rest
constexpr double kPeakTorque = 1.5;     // of tau_max: what the motors have in reserve

}  // namespace

Robot::Robot(const models::Arm& arm, bool ideal, std::uint64_t seed)
    : checks_(arm),
      model_(arm),
      desired_model_(arm),
      generator_(arm),
      desired_(generator_.desired()),
      sensors_(arm, ideal, seed) {
  configure();
}

void Robot::set_version(fci::Version version) {
  version_ = version;
  checks_.set_version(version);
}

// Puts the settings into models, controllers and state.
void Robot::configure() {
  F_T_EE_ = settings_.F_T_EE();
  const RigidBody tool = joined(settings_.end_effector, settings_.load);
  model_.set_tool(tool.mass, tool.com, tool.inertia);
  internal_.K_theta = vector(settings_.joint_impedance.K_theta);
  internal_.K_x = vector(settings_.cartesian_impedance.K_x);
  internal_.EE_T_K = matrix(settings_.EE_T_K);
  rest_at(desired_.q);  // with the new end effector
  state_.F_T_NE = pose(settings_.F_T_NE);
  state_.NE_T_EE = settings_.NE_T_EE;
  state_.F_T_EE = pose(F_T_EE_);
  state_.EE_T_K = settings_.EE_T_K;
  state_.m_ee = settings_.end_effector.mass;
  put(settings_.end_effector.com, state_.F_x_Cee);
  put(settings_.end_effector.inertia, state_.I_ee);
  state_.m_load = settings_.load.mass;
  put(settings_.load.com, state_.F_x_Cload);
  put(settings_.load.inertia, state_.I_load);
}

// --- requests -------------------------------------------------------------------------------------------------

Status Robot::start(const fci::Move& request) {
  const auto controller = request.controller_mode;
  const auto generator = request.motion_generator_mode;
  const bool torques = controller == ControllerMode::kExternal;
  const Mode last = version_ >= fci::kTorqueFinishedVersion ? Mode::kNone : Mode::kCartesianVelocity;
  if (controller > ControllerMode::kExternal || generator == Mode::kIdle || generator > last ||
      (generator == Mode::kNone && !torques)) {
    return Status::kInvalidArgument;
  }
  const bool asynchronous = request.use_async_motion_generator;
  if (asynchronous && (torques || generator != Mode::kJointPosition || !checks_.possible(request.maximum_velocity))) {
    return Status::kInvalidArgument;
  }
  for (const fci::Deviation& deviation : {request.maximum_path_deviation, request.maximum_goal_pose_deviation}) {
    if (!(deviation.translation > 0 && deviation.rotation > 0 && deviation.elbow > 0)) return Status::kInvalidArgument;
  }
  if (const auto refusal = why_not_now()) return *refusal;

  phase_ = Phase::kMoving;
  outcome_.reset();
  motion_ = {};
  motion_.controller = controller;
  motion_.generator = generator;
  motion_.asynchronous = asynchronous;
  motion_.accepted_at = state_.message_id;
  state_.reflex_reason = {};
  generator_.start(generator, desired_.q, F_T_EE_);
  desired_ = generator_.desired();
  checks_.start(request, external() ? model_ : generator_.model());
  if (asynchronous) asynchronous_.start(checks_.limits(), desired_.q, request.maximum_velocity);
  last_command_ = {};
  put(desired_.q, last_command_.q_c);
  last_command_.O_T_EE_c = pose(desired_.O_T_EE_c);
  if (torques) tau_J_d_.setZero();
  return Status::kMotionStarted;
}

void Robot::stop() {
  if (phase_ != Phase::kMoving) return;
  phase_ = Phase::kStopping;
  begin_braking(true);
}

// Why a request that wants an idle robot is refused.
std::optional<Status> Robot::why_not_now() const {
  if (phase_ == Phase::kIdle) return std::nullopt;
  const bool safety_function = phase_ == Phase::kHalted && !enabled_ && !user_stop_ && !locked_;
  if (safety_function && version_ >= kSafetyStatuses) return Status::kRejectedDueToActivatedSafetyFunctions;
  return Status::kNotPossible;
}

Status Robot::recover() {
  if (phase_ != Phase::kReflex) {
    if (phase_ == Phase::kIdle) clear_errors();  // collisions that were felt while nothing guarded the arm
    if (const auto refusal = why_not_now()) return *refusal;
    return recovered_ = Status::kSuccess;
  }
  if (!checks_.inside_range(sensors_.q)) return Status::kManualErrorRecoveryRequired;
  phase_ = Phase::kRecovering;
  recovery_ = kRecoveryCycles;
  return recovered_ = Status::kSuccess;
}

void Robot::abandon() {
  if (moving()) reflex(Error::kCommunicationConstraints);
}

// --- people at the robot --------------------------------------------------------------------------------------

void Robot::user_stop(bool pressed) {
  if (user_stop_ && !pressed && checks_.inside_range(sensors_.q)) clear_errors();
  user_stop_ = pressed;
  obey_stops();
}

void Robot::enabling_device(bool held) {
  enabled_ = held;
  obey_stops();
}

void Robot::lock(bool locked) {
  if (moving() || phase_ == Phase::kGuiding) return;
  locked_ = locked;
  obey_stops();
}

// Into kHalted; control() leaves it.
void Robot::obey_stops() {
  if ((!user_stop_ && enabled_ && !locked_) || phase_ == Phase::kHalted || phase_ == Phase::kGuiding) return;
  const bool safety_function = !user_stop_ && version_ >= kSafetyStatuses;
  if (moving()) {
    outcome_ = safety_function ? Status::kPreemptedDueToActivatedSafetyFunctions : Status::kEmergencyAborted;
  }
  if (recovering()) recovered_ = Status::kEmergencyAborted;
  begin_braking(true);
  phase_ = Phase::kHalted;
}

void Robot::guide(bool pressed) {
  guide_ = pressed;
  obey_guiding();
  if (!pressed && phase_ == Phase::kGuiding) {
    holding_ = ControllerMode::kJointImpedance;
    rest_at(sensors_.q);
    phase_ = Phase::kHalted;
  }
}

// Into kGuiding, once the arm rests.
void Robot::obey_guiding() {
  if (!guide_ || phase_ != Phase::kHalted || !user_stop_ || locked_ || !desired_.dq.isZero(0)) return;
  guiding_.start(settings_.guiding, model_, F_T_EE_, sensors_.q);
  phase_ = Phase::kGuiding;
}

void Robot::inject(Error error) { reflex(error); }

void Robot::clear_errors() {
  state_.errors = {};
  contact_.reset();
}

// --- the cycle ------------------------------------------------------------------------------------------------

bool Robot::expects(const fci::RobotCommand& command) const {
  const std::uint64_t id = command.message_id;
  if (phase_ != Phase::kMoving || id <= motion_.accepted_at || id > state_.message_id) return false;
  return motion_.asynchronous ? id >= motion_.echoed : id == state_.message_id;
}

bool Robot::takes(const fci::RobotCommand& command) {
  const bool expected = expects(command);
  const std::uint64_t id = command.message_id;
  // Late ones count as well.
  if (phase_ == Phase::kMoving && id > motion_.accepted_at && id <= state_.message_id) motion_.begun = true;
  if (expected) motion_.echoed = id;
  return expected;
}

void Robot::advance_phase(const fci::RobotCommand* command) {
  switch (phase_) {
    case Phase::kMoving:
      if (motion_.asynchronous) {
        follow_target(command);
      } else if (command != nullptr) {
        follow(*command);
      } else if (motion_.begun) {
        lose();
      }
      break;
    case Phase::kStopping:
      brake();
      if (desired_.dq.isZero(0)) end(Status::kPreempted);
      break;
    case Phase::kReflex: brake(); break;
    case Phase::kRecovering:
      if (!desired_.dq.isZero(0)) {
        brake();
        break;
      }
      // No longer pressed against what it has run into.
      if (recovery_ == kRecoveryCycles) rest_at(sensors_.q);
      if (--recovery_ <= 0) {
        phase_ = Phase::kIdle;
        clear_errors();
      }
      break;
    case Phase::kHalted:
      brake();
      if (!user_stop_ && enabled_ && !locked_ && desired_.dq.isZero(0)) {
        phase_ = fci::any(state_.errors) ? Phase::kReflex : Phase::kIdle;
        desired_.ddq.setZero();
      }
      obey_guiding();
      break;
    case Phase::kGuiding: rest_at(sensors_.q); break;
    case Phase::kIdle: break;
  }
}

bool Robot::under_way() const {
  const bool swings = phase_ == Phase::kReflex && sensors_.dq.cwiseAbs().maxCoeff() > kSwinging;
  return swings || awaits_command() || asynchronous() || phase_ == Phase::kStopping || phase_ == Phase::kGuiding || !desired_.dq.isZero(0);
}

void Robot::stand_still() {
  if (!under_way()) advance_phase(nullptr);
  report();
}

Vector7 Robot::control(const fci::RobotCommand* command) {
  advance_phase(command);
  const Vector tau_max = kPeakTorque * vector(checks_.limits().tau_max);
  tau_motor_ = (law() + model_.gravity()).cwiseMax(-tau_max).cwiseMin(tau_max);
  Vector7 tau_motor;
  put(tau_motor_, tau_motor);
  return tau_motor;
}

void Robot::follow(fci::RobotCommand command) {
  count(true);
  motion_.lost = 0;
  if (const auto error = checks_.values(command)) {
    reflex(*error, Status::kInputErrorAborted);
    return;
  }
  filter(command);
  last_command_ = command;
  const bool first = !motion_.commanded;
  motion_.commanded = true;
  if (reflex(first ? checks_.first(command, desired_) : checks_.elbow(command, desired_)) || !advance(&command, first)) return;
  if (external()) {
    const Vector tau = vector(command.tau_J_d);
    if (reflex(checks_.torque(tau, tau_J_d_))) return;
    tau_J_d_ = tau;
  }
  const bool torques_alone = motion_.generator == Mode::kNone;
  if (command.motion_generation_finished || (torques_alone && command.torque_command_finished)) finish();
}

// The robot itself makes the motion, whether a new target has come or not.
void Robot::follow_target(const fci::RobotCommand* command) {
  count(true);  // there is none that could be lost
  if (command != nullptr && command->motion_generation_finished) {
    motion_.finishing = true;  // libfranka sends no target with it, but zeros
  } else if (command != nullptr && !motion_.finishing) {
    if (const auto error = checks_.values(*command)) {
      reflex(*error, Status::kInputErrorAborted);
      return;
    }
    if (reflex(checks_.target(vector(command->q_c)))) return;
    asynchronous_.aim(command->q_c);
  }
  fci::RobotCommand next;
  next.q_c = asynchronous_.step();
  if (advance(&next) && motion_.finishing && asynchronous_.arrived()) finish();
}

// The robot goes on as it thinks that the client would have: constant acceleration, the same torque.
void Robot::lose() {
  count(false);
  if (++motion_.lost >= kLostCommands) {
    reflex(Error::kCommunicationConstraints);
    return;
  }
  advance(nullptr);
}

// The desired motion by a cycle; without a command as the robot extrapolates. False: it breaks a limit, and is not
// made.
bool Robot::advance(const fci::RobotCommand* command, bool first) {
  if (motion_.generator == Mode::kNone) {
    rest_at(sensors_.q);
    return true;
  }
  if (first && checks_.begins(*command, desired_)) {
    generator_.begin(*command);
  } else if (command != nullptr) {
    generator_.step(*command);
  } else {
    generator_.extrapolate();
  }
  if (reflex(checks_.reference(desired_, generator_.desired()))) return false;
  desired_ = generator_.desired();
  return true;
}

void Robot::count(bool received) {
  motion_.received <<= 1;
  motion_.received[0] = received;
  motion_.cycles = std::min(motion_.cycles + 1, motion_.received.size());
}

// Up to version 5 the robot can filter what it is commanded.
void Robot::filter(fci::RobotCommand& command) {
  const auto gain_at = [](double frequency) { return frequency < kNoFilter ? low_pass_gain(frequency) : 1; };
  const auto smooth = [&](auto& values, const auto& before, double frequency) {
    const double gain = gain_at(frequency);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = gain * values[i] + (1 - gain) * before[i];
  };
  smooth(command.q_c, last_command_.q_c, settings_.filters.joint_position_filter_frequency);
  smooth(command.dq_c, last_command_.dq_c, settings_.filters.joint_velocity_filter_frequency);
  smooth(command.O_dP_EE_c, last_command_.O_dP_EE_c, settings_.filters.cartesian_velocity_filter_frequency);
  smooth(command.tau_J_d, last_command_.tau_J_d, settings_.filters.controller_filter_frequency);
  if (const double gain = gain_at(settings_.filters.cartesian_position_filter_frequency); gain < 1) {
    const Eigen::Matrix4d from = matrix(last_command_.O_T_EE_c);
    Eigen::Matrix4d to = matrix(command.O_T_EE_c);
    to.topRightCorner<3, 1>() = gain * to.topRightCorner<3, 1>() + (1 - gain) * from.topRightCorner<3, 1>();
    const Eigen::Matrix3d R = from.topLeftCorner<3, 3>();
    to.topLeftCorner<3, 3>() = rotation_of(gain * rotation_between(R, to.topLeftCorner<3, 3>())) * R;
    command.O_T_EE_c = pose(to);
  }
}

void Robot::finish() {
  if (!reflex(checks_.finish(desired_, sensors_.dq, matrix(state_.O_T_EE), sensors_.q))) end(Status::kSuccess);
}

// After a motion with an internal controller this one goes on and holds q_d, after torques the arm is held where it is.
void Robot::end(Status outcome) {
  phase_ = Phase::kIdle;
  outcome_ = outcome;
  if (external()) {
    holding_ = ControllerMode::kJointImpedance;
    rest_at(outcome == Status::kSuccess ? sensors_.q : desired_.q);
  } else {
    holding_ = motion_.controller;
    rest_at(desired_.q);
  }
}

void Robot::reflex(Error error, Status outcome) {
  if (phase_ == Phase::kIdle || moving()) {
    if (moving()) outcome_ = outcome;
    // After a collision the arm does not press on.
    begin_braking(error != Error::kJointReflex && error != Error::kCartesianReflex);
    phase_ = Phase::kReflex;
  }
  state_.errors[static_cast<std::size_t>(error)] = true;
  state_.reflex_reason = state_.errors;
}

// What is felt beyond the thresholds. They guard an arm that is to move or to hold.
void Robot::react() {
  if (phase_ != Phase::kIdle && !moving()) return;
  const bool joint = contact_.joint, cartesian = contact_.cartesian;
  if (joint) reflex(Error::kJointReflex);
  if (cartesian) reflex(Error::kCartesianReflex);
}

// All of them; true if there is one.
bool Robot::reflex(const fci::Errors& errors) {
  for (std::size_t i = 0; i < errors.size(); ++i) {
    if (errors[i]) reflex(static_cast<Error>(i));
  }
  return fci::any(errors);
}

void Robot::rest_at(const Vector& q) {
  generator_.start(Mode::kIdle, q, F_T_EE_);
  desired_ = generator_.desired();
}

// How a robot stops is not published: here each joint as hard as it may be commanded to, from the reference where one
// is followed, and by the same law; else from where the arm is.
void Robot::begin_braking(bool from_reference) {
  if (from_reference && !(moving() && external())) {
    if (moving()) holding_ = motion_.controller;
    return;
  }
  holding_ = ControllerMode::kJointImpedance;
  rest_at(sensors_.q);
  desired_.dq = sensors_.dq;
}

void Robot::brake() {
  if (desired_.dq.isZero(0)) {
    desired_.ddq.setZero();
    return;
  }
  const Vector before = desired_.dq;
  const Vector step = kDt * vector(checks_.limits().ddq_max);
  const Vector dq = before - before.cwiseMax(-step).cwiseMin(step);
  const Vector q = desired_.q + kDt * dq;
  rest_at(q);
  desired_.dq = dq;
  desired_.ddq = (dq - before) / kDt;
}

// tau_d without gravity; what it is while torques are commanded, the client says.
Robot::Vector Robot::law() {
  if (phase_ == Phase::kGuiding) return tau_J_d_ = guiding_.torque(model_, F_T_EE_, sensors_.q, sensors_.dq);
  const bool torques = phase_ == Phase::kMoving && external();
  if (torques && motion_.cycles > 0) return tau_J_d_;
  const auto controller = phase_ == Phase::kMoving && !torques ? motion_.controller : holding_;
  const Vector tau = controller == ControllerMode::kCartesianImpedance
                         ? internal_.cartesian_impedance(model_, F_T_EE_, sensors_.q, sensors_.dq, desired_)
                         : internal_.joint_impedance(model_, sensors_.q, sensors_.dq, desired_);
  // Until the first torque it is held as it was before, and reports none.
  return torques ? tau : tau_J_d_ = tau;
}

void Robot::sense(const Truth& truth) {
  sensors_.read(truth);
  model_.update(sensors_.q, sensors_.dq);
  if (sensed_) {
    external_force_.update(model_, sensors_, F_T_EE_ * internal_.EE_T_K);
    const bool accelerating = !desired_.ddq.isZero(kAccelerating);
    contact_.update(settings_.collision, accelerating, external_force_.tau, external_force_.K_F_K);
    react();
  } else {
    rest_at(sensors_.q);
    sensed_ = true;
  }
  // Guided farther out of the range that it has left.
  if (phase_ == Phase::kGuiding && state_.errors[static_cast<std::size_t>(Error::kJointPositionLimits)] &&
      checks_.leaves_range(sensors_.q, sensors_.dq)) {
    reflex(Error::kJointMoveInWrongDirection);
  }
  if (phase_ == Phase::kMoving) {
    reflex(checks_.arm(model_, F_T_EE_, sensors_.q, sensors_.dq, sensors_.tau_J, tau_motor_, desired_));
    reflex(checks_.collision(external() ? model_ : generator_.model()));
  }
  report();
}

void Robot::report() {
  fci::RobotState& s = state_;
  ++s.message_id;

  s.O_T_EE = pose(model_.O_T_F() * F_T_EE_);
  put(sensors_.tau_J, s.tau_J);
  put(sensors_.dtau_J, s.dtau_J);
  put(sensors_.q, s.q);
  put(sensors_.dq, s.dq);
  put(sensors_.theta, s.theta);
  put(sensors_.dtheta, s.dtheta);
  s.elbow = elbow(sensors_.q);
  s.O_ddP_O = {0, 0, -9.81};
  s.accelerometer_top = sensors_.accelerometer_top;
  s.accelerometer_bottom = sensors_.accelerometer_bottom;

  put(external_force_.tau, s.tau_ext_hat_filtered);
  put(external_force_.O_F_K, s.O_F_ext_hat_K);
  put(external_force_.K_F_K, s.K_F_ext_hat_K);
  s.joint_contact = contact_.joint_contact;
  s.cartesian_contact = contact_.cartesian_contact;
  s.joint_collision = contact_.joint_collision;
  s.cartesian_collision = contact_.cartesian_collision;

  put(desired_.q, s.q_d);
  put(desired_.dq, s.dq_d);
  put(desired_.ddq, s.ddq_d);
  put(tau_J_d_, s.tau_J_d);
  s.O_T_EE_d = pose(desired_.O_T_EE_d);
  desired_model_.update_kinematics(desired_.q);
  put(Wrench(desired_model_.jacobian(F_T_EE_.topRightCorner<3, 1>()) * desired_.dq), s.O_dP_EE_d);
  s.elbow_d = elbow(desired_.q);
  s.O_T_EE_c = pose(desired_.O_T_EE_c);
  put(desired_.O_dP_EE_c, s.O_dP_EE_c);
  put(desired_.O_ddP_EE_c, s.O_ddP_EE_c);
  s.elbow_c = desired_.elbow_c;
  s.delbow_c = desired_.delbow_c;
  s.ddelbow_c = desired_.ddelbow_c;

  s.motion_generator_mode = moving() ? motion_.generator : Mode::kIdle;
  s.controller_mode = moving() ? motion_.controller : holding_;
  switch (phase_) {
    case Phase::kIdle: s.robot_mode = RobotMode::kIdle; break;
    case Phase::kMoving:
    case Phase::kStopping: s.robot_mode = RobotMode::kMove; break;
    case Phase::kReflex: s.robot_mode = RobotMode::kReflex; break;
    case Phase::kRecovering: s.robot_mode = RobotMode::kAutomaticErrorRecovery; break;
    case Phase::kHalted: s.robot_mode = locked_ ? RobotMode::kOther : RobotMode::kUserStopped; break;
    case Phase::kGuiding: s.robot_mode = RobotMode::kGuiding; break;
  }
  s.control_command_success_rate =
      phase_ == Phase::kMoving && motion_.cycles > 0
          ? static_cast<double>(motion_.received.count()) / static_cast<double>(motion_.cycles)
          : 0;
}

}  // namespace sim
