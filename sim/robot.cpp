#include "sim/robot.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "sim/franka_hand.hpp"
#include "sim/joint_figures.hpp"
#include "sim/rotation.hpp"
#include "sim/transform.hpp"

namespace sim {
namespace {

using fci::ControllerMode;
using fci::Error;
using fci::RobotMode;
using fci::Status;
using Mode = fci::MotionGeneratorMode;
using Vector = Eigen::Matrix<double, 7, 1>;
using Wrench = Eigen::Matrix<double, 6, 1>;

constexpr double kDt = 0.001;  // s

// What Franka does not publish.
constexpr int kRecoveryCycles = 50;
constexpr double kExternalForceFilter = 15;    // Hz, of tau_ext_hat_filtered
constexpr double kTorqueRateFilter = 100;      // Hz, of dtau_J
constexpr double kNoFilter = 1000;             // Hz: a command filter at this frequency is off

// What its own examples set (setDefaultBehavior); the thresholds after power-on are not published.
constexpr fci::SetCollisionBehavior kCollisionBehavior = {
    .lower_torque_thresholds_acceleration = {20, 20, 20, 20, 20, 20, 20},
    .upper_torque_thresholds_acceleration = {20, 20, 20, 20, 20, 20, 20},
    .lower_torque_thresholds_nominal = {10, 10, 10, 10, 10, 10, 10},
    .upper_torque_thresholds_nominal = {10, 10, 10, 10, 10, 10, 10},
    .lower_force_thresholds_acceleration = {20, 20, 20, 20, 20, 20},
    .upper_force_thresholds_acceleration = {20, 20, 20, 20, 20, 20},
    .lower_force_thresholds_nominal = {10, 10, 10, 10, 10, 10},
    .upper_force_thresholds_nominal = {10, 10, 10, 10, 10, 10},
};

template <std::size_t N>
Eigen::Map<const Eigen::Matrix<double, static_cast<int>(N), 1>> vector(const std::array<double, N>& values) {
  return Eigen::Map<const Eigen::Matrix<double, static_cast<int>(N), 1>>(values.data());
}

template <std::size_t N, class Matrix>
void put(const Matrix& from, std::array<double, N>& to) {
  Eigen::Map<Eigen::Matrix<double, Matrix::RowsAtCompileTime, Matrix::ColsAtCompileTime>>(to.data()) = from;
}

template <class Values>
bool within(const Values& values, double low, double high) {
  return std::all_of(values.begin(), values.end(), [&](double x) { return x >= low && x <= high; });
}

double low_pass_gain(double frequency) {
  return frequency >= kNoFilter ? 1 : 1 / (1 + 1 / (2 * M_PI * frequency * kDt));
}

std::array<double, 2> elbow(const Vector& q) { return {q[2], q[3] > models::kElbowFlip ? 1. : -1.}; }

// At rest, in the axes of each link's two sensors: those of the link. What they feel of the motion is left out.
std::array<double, 18> accelerometers(const models::Arm& arm, const Vector& q) {
  std::array<double, 18> felt;
  Eigen::Vector3d up(0, 0, 9.81);
  for (int i = 0; i < 6; ++i) {
    const auto& rpy = arm.joints[i].rpy;
    const Eigen::Quaterniond turn = Eigen::AngleAxisd(rpy[2], Eigen::Vector3d::UnitZ()) *
                                    Eigen::AngleAxisd(rpy[1], Eigen::Vector3d::UnitY()) *
                                    Eigen::AngleAxisd(rpy[0], Eigen::Vector3d::UnitX()) *
                                    Eigen::AngleAxisd(q[i], Eigen::Vector3d::UnitZ());
    up = turn.conjugate() * up;
    Eigen::Map<Eigen::Vector3d>(felt.data() + 3 * i) = up;
  }
  return felt;
}

}  // namespace

Robot::Robot(const models::Arm& arm)
    : arm_(arm),
      limits_(&models::limits(arm, fci::kNewestVersion)),
      model_(arm),
      desired_model_(arm),
      generator_(arm),
      collision_(kCollisionBehavior),
      end_effector_(franka_hand()),
      F_T_NE_(F_T_hand_TCP()),
      desired_(generator_.desired()) {
  configure();
}

void Robot::set_version(fci::Version version) {
  version_ = version;
  limits_ = &models::limits(arm_, version);
}

// End effector and load as they are configured, in the models and in the state.
void Robot::configure() {
  F_T_EE_ = F_T_NE_ * NE_T_EE_;
  const RigidBody tool = joined(end_effector_, load_);
  model_.set_tool(tool.mass, tool.com, tool.inertia);
  state_.F_T_NE = pose(F_T_NE_);
  state_.NE_T_EE = pose(NE_T_EE_);
  state_.F_T_EE = pose(F_T_EE_);
  state_.EE_T_K = pose(internal_.EE_T_K);
  state_.m_ee = end_effector_.mass;
  put(end_effector_.com, state_.F_x_Cee);
  put(end_effector_.inertia, state_.I_ee);
  state_.m_load = load_.mass;
  put(load_.com, state_.F_x_Cload);
  put(load_.inertia, state_.I_load);
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
  // Of the asynchronous generator nothing is published that one could build it from.
  if (request.use_async_motion_generator) return Status::kInvalidArgument;
  for (const fci::Deviation& deviation : {request.maximum_path_deviation, request.maximum_goal_pose_deviation}) {
    if (!(deviation.translation > 0 && deviation.rotation > 0 && deviation.elbow > 0)) return Status::kInvalidArgument;
  }
  if (phase_ != Phase::kIdle) return Status::kNotPossible;

  phase_ = Phase::kMoving;
  outcome_.reset();
  motion_ = {};
  motion_.controller = controller;
  motion_.generator = generator;
  motion_.accepted_at = state_.message_id;
  state_.reflex_reason = {};
  generator_.start(generator, desired_.q, F_T_EE_);
  desired_ = generator_.desired();
  last_command_ = {};
  put(desired_.q, last_command_.q_c);
  last_command_.O_T_EE_c = pose(desired_.O_T_EE_c);
  if (torques) tau_J_d_.setZero();
  return Status::kMotionStarted;
}

void Robot::stop() {
  if (phase_ != Phase::kMoving) return;
  phase_ = Phase::kStopping;
  begin_braking();
}

Status Robot::recover() {
  if (moving()) return Status::kNotPossible;
  if (phase_ == Phase::kReflex) {
    phase_ = Phase::kRecovering;
    recovery_ = kRecoveryCycles;
  }
  return Status::kSuccess;
}

void Robot::abandon() {
  if (moving()) reflex(Error::kCommunicationConstraints);
}

Status Robot::set(const fci::SetCollisionBehavior& request) {
  constexpr double kInfinity = std::numeric_limits<double>::max();
  for (const auto& thresholds :
       {request.lower_torque_thresholds_acceleration, request.upper_torque_thresholds_acceleration,
        request.lower_torque_thresholds_nominal, request.upper_torque_thresholds_nominal}) {
    if (!within(thresholds, 0, kInfinity)) return Status::kInvalidArgument;
  }
  for (const auto& thresholds :
       {request.lower_force_thresholds_acceleration, request.upper_force_thresholds_acceleration,
        request.lower_force_thresholds_nominal, request.upper_force_thresholds_nominal}) {
    if (!within(thresholds, 0, kInfinity)) return Status::kInvalidArgument;
  }
  if (phase_ != Phase::kIdle) return Status::kNotPossible;
  collision_ = request;
  return Status::kSuccess;
}

Status Robot::set(const fci::SetJointImpedance& request) {
  if (!within(request.K_theta, 0, 14250)) return Status::kInvalidArgument;
  if (phase_ != Phase::kIdle) return Status::kNotPossible;
  internal_.K_theta = vector(request.K_theta);
  return Status::kSuccess;
}

Status Robot::set(const fci::SetCartesianImpedance& request) {
  for (int i = 0; i < 6; ++i) {
    const double low = i < 3 ? 10 : 1, high = i < 3 ? 3000 : 300;
    if (!(request.K_x[i] >= low && request.K_x[i] <= high)) return Status::kInvalidArgument;
  }
  if (phase_ != Phase::kIdle) return Status::kNotPossible;
  internal_.K_x = vector(request.K_x);
  return Status::kSuccess;
}

// Says which axes a hand that presses the guiding button would free; nobody presses it here.
Status Robot::set(const fci::SetGuidingMode&) {
  return phase_ == Phase::kIdle ? Status::kSuccess : Status::kNotPossible;
}

Status Robot::set(const fci::SetEEToK& request) {
  if (!is_transform(request.EE_T_K)) return Status::kInvalidArgument;
  if (phase_ != Phase::kIdle) return Status::kNotPossible;
  internal_.EE_T_K = matrix(request.EE_T_K);
  configure();
  return Status::kSuccess;
}

Status Robot::set(const fci::SetNEToEE& request) {
  if (!is_transform(request.NE_T_EE)) return Status::kInvalidArgument;
  if (phase_ != Phase::kIdle) return Status::kNotPossible;
  NE_T_EE_ = matrix(request.NE_T_EE);
  configure();
  rest_at(desired_.q);
  return Status::kSuccess;
}

Status Robot::set(const fci::SetLoad& request) {
  constexpr double kTolerance = 1e-9;  // kg m²
  const Eigen::Map<const Eigen::Matrix3d> I(request.I_load.data());
  if (!(request.m_load >= 0) || !std::isfinite(request.m_load) || !vector(request.F_x_Cload).allFinite() ||
      !I.allFinite() || (I - I.transpose()).cwiseAbs().maxCoeff() > kTolerance ||
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(I, Eigen::EigenvaluesOnly).eigenvalues().minCoeff() <
          -kTolerance) {
    return Status::kInvalidArgument;
  }
  if (phase_ != Phase::kIdle) return Status::kNotPossible;
  load_ = {request.m_load, vector(request.F_x_Cload), I};
  configure();
  return Status::kSuccess;
}

Status Robot::set(const fci::SetFilters& request) {
  for (double frequency : {request.joint_position_filter_frequency, request.joint_velocity_filter_frequency,
                           request.cartesian_position_filter_frequency, request.cartesian_velocity_filter_frequency,
                           request.controller_filter_frequency}) {
    if (!(frequency > 0 && frequency <= kNoFilter)) return Status::kInvalidArgument;
  }
  if (phase_ != Phase::kIdle) return Status::kNotPossible;
  filters_ = request;
  return Status::kSuccess;
}

// --- the cycle ------------------------------------------------------------------------------------------------

bool Robot::takes(const fci::RobotCommand& command) {
  if (phase_ != Phase::kMoving || command.message_id <= motion_.accepted_at) return false;
  if (command.message_id > state_.message_id) return false;
  motion_.begun = true;
  return command.message_id == state_.message_id;
}

Vector7 Robot::control(const fci::RobotCommand* command) {
  switch (phase_) {
    case Phase::kMoving:
      if (command != nullptr) {
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
      brake();
      if (--recovery_ <= 0 && desired_.dq.isZero(0)) {
        phase_ = Phase::kIdle;
        state_.errors = {};
      }
      break;
    case Phase::kIdle: break;
  }
  const Vector tau = law() + model_.gravity();
  const auto tau_max = vector(limits_->tau_max);
  Vector7 tau_motor;
  put(Vector(tau.cwiseMax(-tau_max).cwiseMin(tau_max)), tau_motor);
  return tau_motor;
}

void Robot::follow(fci::RobotCommand command) {
  count(true);
  motion_.lost = 0;
  if (const auto error = check_values(motion_.controller, motion_.generator, command)) {
    reflex(*error, Status::kInputErrorAborted);
    return;
  }
  filter(command);
  last_command_ = command;
  if (external()) tau_J_d_ = vector(command.tau_J_d);
  if (motion_.generator == Mode::kNone) {
    rest_at(q_);
  } else {
    generator_.step(command);
    desired_ = generator_.desired();
  }
  const bool torques_alone = motion_.generator == Mode::kNone;
  if (command.motion_generation_finished || (torques_alone && command.torque_command_finished)) finish();
}

// The robot goes on as it thinks that the client would have: constant acceleration, the same torque.
void Robot::lose() {
  count(false);
  if (++motion_.lost >= kLostCommands) {
    reflex(Error::kCommunicationConstraints);
    return;
  }
  if (motion_.generator == Mode::kNone) {
    rest_at(q_);
  } else {
    generator_.extrapolate();
    desired_ = generator_.desired();
  }
}

void Robot::count(bool received) {
  motion_.received <<= 1;
  motion_.received[0] = received;
  motion_.cycles = std::min(motion_.cycles + 1, motion_.received.size());
}

// Up to version 5 the robot can filter what it is commanded.
void Robot::filter(fci::RobotCommand& command) {
  const auto smooth = [](auto& values, const auto& before, double frequency) {
    const double gain = low_pass_gain(frequency);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = gain * values[i] + (1 - gain) * before[i];
  };
  smooth(command.q_c, last_command_.q_c, filters_.joint_position_filter_frequency);
  smooth(command.dq_c, last_command_.dq_c, filters_.joint_velocity_filter_frequency);
  smooth(command.O_dP_EE_c, last_command_.O_dP_EE_c, filters_.cartesian_velocity_filter_frequency);
  smooth(command.tau_J_d, last_command_.tau_J_d, filters_.controller_filter_frequency);
  if (const double gain = low_pass_gain(filters_.cartesian_position_filter_frequency); gain < 1) {
    const Eigen::Matrix4d from = matrix(last_command_.O_T_EE_c);
    Eigen::Matrix4d to = matrix(command.O_T_EE_c);
    to.topRightCorner<3, 1>() = gain * to.topRightCorner<3, 1>() + (1 - gain) * from.topRightCorner<3, 1>();
    const Eigen::Matrix3d R = from.topLeftCorner<3, 3>();
    to.topLeftCorner<3, 3>() = rotation_of(gain * rotation_between(R, to.topLeftCorner<3, 3>())) * R;
    command.O_T_EE_c = pose(to);
  }
}

void Robot::finish() {
  // Protocol 5 to 9 has no other way to say "torques alone" than with joint velocities of zero.
  const bool reference = motion_.generator != Mode::kNone;
  auto error = reference ? check_finish(*limits_, motion_.generator, desired_) : std::nullopt;
  if (!error && external()) error = check_finish(dq_);
  if (error) {
    reflex(*error);
  } else {
    end(Status::kSuccess);
  }
}

// After a motion with an internal controller this one goes on and holds q_d, after torques the arm is held where it is.
void Robot::end(Status outcome) {
  phase_ = Phase::kIdle;
  outcome_ = outcome;
  if (external()) {
    holding_ = ControllerMode::kJointImpedance;
    rest_at(outcome == Status::kSuccess ? q_ : desired_.q);
  } else {
    holding_ = motion_.controller;
    rest_at(desired_.q);
  }
}

void Robot::reflex(Error error, Status outcome) {
  begin_braking();
  holding_ = ControllerMode::kJointImpedance;
  phase_ = Phase::kReflex;
  outcome_ = outcome;
  state_.errors[static_cast<std::size_t>(error)] = true;
  state_.reflex_reason = state_.errors;
}

void Robot::rest_at(const Vector& q) {
  generator_.start(Mode::kIdle, q, F_T_EE_);
  desired_ = generator_.desired();
}

// How a robot stops is not published: here each joint as hard as it may be commanded to, from the reference if the
// arm follows one in its joints, else from where it is.
void Robot::begin_braking() {
  if (motion_.controller == ControllerMode::kJointImpedance) {
    holding_ = ControllerMode::kJointImpedance;
    return;
  }
  const Vector dq = dq_;
  holding_ = ControllerMode::kJointImpedance;
  rest_at(q_);
  desired_.dq = dq;
}

void Robot::brake() {
  if (desired_.dq.isZero(0)) return;
  const Vector before = desired_.dq;
  const Vector step = kDt * vector(limits_->ddq_max);
  const Vector dq = before - before.cwiseMax(-step).cwiseMin(step);
  const Vector q = desired_.q + kDt * dq;
  rest_at(q);
  desired_.dq = dq;
  desired_.ddq = (dq - before) / kDt;
}

// tau_d without gravity; what it is while torques are commanded, the client says.
Robot::Vector Robot::law() {
  if (phase_ == Phase::kMoving && external()) {
    if (motion_.cycles > 0) return tau_J_d_;
    return internal_.joint_impedance(model_, q_, dq_, desired_);  // holds until the first torque, and reports none
  }
  const auto controller = phase_ == Phase::kMoving ? motion_.controller : holding_;
  tau_J_d_ = controller == ControllerMode::kCartesianImpedance
                 ? internal_.cartesian_impedance(model_, F_T_EE_, q_, dq_, desired_)
                 : internal_.joint_impedance(model_, q_, dq_, desired_);
  return tau_J_d_;
}

void Robot::sense(const Truth& truth) {
  const Vector dq_before = dq_, tau_J_before = tau_J_;
  q_ = vector(truth.q);
  dq_ = vector(truth.dq);
  tau_J_ = vector(truth.tau_J);
  model_.update(q_, dq_);
  if (sensed_) {
    dtau_J_ += low_pass_gain(kTorqueRateFilter) * ((tau_J_ - tau_J_before) / kDt - dtau_J_);
    const Vector expected = model_.mass() * ((dq_ - dq_before) / kDt) + model_.coriolis() + model_.gravity();
    tau_ext_ += low_pass_gain(kExternalForceFilter) * (tau_J_ - expected - tau_ext_);
  } else {
    rest_at(q_);
    sensed_ = true;
  }
  report();
}

void Robot::report() {
  fci::RobotState& s = state_;
  ++s.message_id;

  s.O_T_EE = pose(model_.O_T_F() * F_T_EE_);
  put(tau_J_, s.tau_J);
  put(dtau_J_, s.dtau_J);
  put(q_, s.q);
  put(dq_, s.dq);
  put(Vector(q_ + tau_J_ / kJointStiffness), s.theta);
  put(Vector(dq_ + dtau_J_ / kJointStiffness), s.dtheta);
  s.elbow = elbow(q_);
  s.O_ddP_O = {0, 0, -9.81};
  s.accelerometer_top = s.accelerometer_bottom = accelerometers(arm_, q_);

  // What the arm exerts on the world, felt in its joints; an arm that is pushed reports the reaction.
  const Eigen::Matrix4d F_T_K = F_T_EE_ * internal_.EE_T_K;
  const ArmModel::Matrix67 J = model_.jacobian(F_T_K.topRightCorner<3, 1>());
  Eigen::Matrix<double, 6, 6> JJt = J * J.transpose();
  JJt.diagonal().array() += 1e-6;  // bounded next to singularities
  const Wrench O_F = JJt.llt().solve(J * tau_ext_);
  const Eigen::Matrix3d O_R_K = (model_.O_T_F() * F_T_K).topLeftCorner<3, 3>();
  put(tau_ext_, s.tau_ext_hat_filtered);
  put(O_F, s.O_F_ext_hat_K);
  Wrench K_F;
  K_F << O_R_K.transpose() * O_F.head<3>(), O_R_K.transpose() * O_F.tail<3>();
  put(K_F, s.K_F_ext_hat_K);
  for (int i = 0; i < 7; ++i) {
    s.joint_contact[i] = std::abs(tau_ext_[i]) > collision_.lower_torque_thresholds_nominal[i];
  }
  for (int i = 0; i < 6; ++i) {
    s.cartesian_contact[i] = std::abs(K_F[i]) > collision_.lower_force_thresholds_nominal[i];
  }

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
  }
  s.control_command_success_rate =
      phase_ == Phase::kMoving && motion_.cycles > 0
          ? static_cast<double>(motion_.received.count()) / static_cast<double>(motion_.cycles)
          : 0;
}

}  // namespace sim
