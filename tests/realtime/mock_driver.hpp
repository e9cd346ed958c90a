#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "models/arm.hpp"
#include "realtime/model.hpp"
#include "realtime/rotation.hpp"
#include "robot/driver.hpp"

namespace testing_tools {

// An ideal arm behind the driver's interface: it obeys the protocol, tracks perfectly, loses what it is
// told to lose, and judges every command as a robot would, by backward differences over 1 ms. Nothing here
// takes from the heap once it is made, so that a test can count what the loop takes.
class MockRobot : public robot::Driver {
 public:
  using Vector3 = realtime::Vector3;
  using Vector7 = realtime::Vector7;

  MockRobot(const models::Arm& arm, fci::Version version)
      : limits(models::limits(arm, version)), model_(models::urdf(arm, version)), version_(version) {
    q_ = Vector7::Map(models::kHome.data());
    state.message_id = 1000;
    state.robot_mode = fci::RobotMode::kIdle;
    rest();
    show();
  }

  const models::Limits limits;

  // --- what a test sets -------------------------------------------------------------------------
  int start_delay = 1;            // states from Move to matching modes
  int started_delay = 0;          // states from matching modes to kMotionStarted; may be negative
  int success_delay = 0;          // states from idle to the end of Move
  int answer_delay = 1;           // states from a setter to its answer
  bool success_first = false;     // the end of Move is answered one state before idle shows
  std::optional<fci::Command> silent;   // this request is never answered, nor obeyed
  std::optional<fci::Command> refused;  // this one is refused
  fci::Status refusal = fci::Status::kNotPossible;
  robot::Received connection = robot::Received::kState;
  std::array<int, 8> ticks = {1, 1, 1, 1, 1, 1, 1, 1};  // ms of the next states, in turn
  std::uint64_t leap = 0;  // ms that its clock shows more from the next state on, though no time has passed
  int lose = 0;  // of the next commands
  std::int64_t received = 0;  // ns, when the last state came
  Vector7 yields = Vector7::Zero();  // rad that the arm is away from q_d while the robot's own law holds it, until torques do
  Vector7 load = Vector7::Zero();  // N m that pull at the arm under torque, unknown to the robot
  bool locked = false;             // something holds the arm, whatever the torque
  std::optional<Eigen::Matrix4d> stale_pose;  // O_T_EE_c while no motion runs, and in its first state

  // From the next state on: a reflex with that error.
  void reflex(fci::Error error) {
    fail_to_ = fci::RobotMode::kReflex;
    error_ = error;
  }
  void user_stop() { fail_to_ = fci::RobotMode::kUserStopped; }
  void release() {  // the user stop
    state.robot_mode = fci::RobotMode::kIdle;
  }

  // --- what it has seen -------------------------------------------------------------------------
  fci::RobotState state;       // in double, before the wire
  fci::RobotCommand command;   // the last one
  std::array<int, 15> posted{};  // requests, by command
  robot::Mode moved;           // of the last Move
  int gap = 0;                 // states without a command before the last commanded one
  int uncommanded = 0;         // states of a motion that were not answered
  int commands = 0;
  double fastest = 0;          // rad/s of a joint under torque alone
  bool finished_while_moving = false;
  bool moved_in_motion = false;     // a request came that the robot takes only at rest
  bool command_in_idle = false;
  double worst_velocity = 0, worst_acceleration = 0, worst_jerk = 0;  // shares of the limits
  double worst_torque = 0, worst_torque_rate = 0;
  double beyond = 0;           // rad beyond the joints' range

  bool obeyed() const {
    return worst_velocity <= 1 && worst_acceleration <= 1 && worst_jerk <= 1 && worst_torque <= 1 &&
           worst_torque_rate <= 1 && beyond <= 0 && !finished_while_moving && !moved_in_motion && !command_in_idle;
  }
  std::string judgement() const {
    return "of the limits: velocity " + std::to_string(worst_velocity) + ", acceleration " +
           std::to_string(worst_acceleration) + ", jerk " + std::to_string(worst_jerk) + ", torque " +
           std::to_string(worst_torque) + ", its rate " + std::to_string(worst_torque_rate) + "; " +
           std::to_string(beyond) + " rad beyond the range" +
           (finished_while_moving ? "; finished while moving" : "") +
           (moved_in_motion ? "; a request during a motion" : "") +
           (command_in_idle ? "; a command without a motion" : "");
  }
  Vector7 q() const { return q_; }
  Vector7 dq() const { return dq_; }
  bool in_motion() const { return in_motion_; }

  // --- Driver ------------------------------------------------------------------------------------
  robot::Received receive(fci::RobotState& out) noexcept override {
    if (connection != robot::Received::kState) return connection;
    const int lapse = ticks[next_tick_++ % ticks.size()];
    state.message_id += std::exchange(leap, 0);
    for (int i = 0; i < lapse; ++i) {
      ++state.message_id;
      tick();
    }
    show();
    // As it comes over the wire: version 10 rounds to float32.
    fci::Writer writer(version_, bytes_.data());
    walk(writer, state);
    fci::Reader reader(version_, bytes_.data());
    walk(reader, out);
    return robot::Received::kState;
  }

  std::int64_t received_ns() const noexcept override { return received; }

  void send(const fci::RobotCommand& sent) noexcept override {
    if (sent.message_id != state.message_id) return;  // late
    if (lose > 0) {
      --lose;
      return;
    }
    command = sent;
    commanded_ = commanded_once_ = true;
    ++commands;
    gap = silence_;
    silence_ = 0;
    if (!in_motion_) command_in_idle = true;
  }

  std::optional<std::uint32_t> post(const robot::Request& request) noexcept override {
    const fci::Command name = std::visit([](const auto& r) { return r.kCommand; }, request);
    ++posted[static_cast<std::size_t>(name)];
    const std::uint32_t id = ++last_id_;
    if (silent == name) return id;
    if (refused == name) {
      answer(id, name, refusal, answer_delay);
      return id;
    }
    if (const auto* move = std::get_if<fci::Move>(&request)) {
      if (in_motion_ || state.robot_mode != fci::RobotMode::kIdle) {
        moved_in_motion = in_motion_;
        answer(id, name, fci::Status::kNotPossible, 0);
        return id;
      }
      moved = {move->controller_mode, move->motion_generator_mode};
      begun_ = lost_ = false;
      move_id_ = id;
      start_in_ = start_delay;
      answer(id, name, fci::Status::kMotionStarted, std::max(0, start_delay + started_delay));
    } else if (name == fci::Command::kAutomaticErrorRecovery) {
      recover_in_ = 5;
      answer(id, name, fci::Status::kSuccess, 3);
    } else if (name == fci::Command::kStopMove) {
      start_in_ = -1;
      if (in_motion_) end(fci::Status::kPreempted);
      answer(id, name, fci::Status::kSuccess, answer_delay);
    } else {
      if (in_motion_) moved_in_motion = true;
      answer(id, name, in_motion_ ? fci::Status::kNotPossible : fci::Status::kSuccess, answer_delay);
    }
    return id;
  }

  std::optional<robot::Answer> poll() noexcept override {
    for (std::size_t i = 0; i < answer_count_; ++i) {
      if (answers_[i].due > state.message_id) continue;
      const robot::Answer found = answers_[i].answer;
      answers_[i] = answers_[--answer_count_];
      return found;
    }
    return std::nullopt;
  }

  fci::Version version() const noexcept override { return version_; }

 private:
  static constexpr double kDt = 0.001;
  static constexpr double kRotors = 0.2;  // kg m², of the motors behind their gears

  void answer(std::uint32_t id, fci::Command name, fci::Status status, int delay) {
    answers_[answer_count_++] = {{id, name, status}, state.message_id + static_cast<std::uint64_t>(delay)};
  }

  void rest() {
    q_d_ = q_;
    v_.setZero();
    a_.setZero();
    dq_.setZero();
    if (moved.generator != fci::MotionGeneratorMode::kCartesianPosition) show_pose();  // there q_ is not kept
    for (Part* part : {&linear_, &angular_}) *part = {};
    tau_.setZero();
  }

  void show_pose() {
    model_.update(q_, dq_);
    position_ = model_.O_T_EE().translation();
    orientation_ = Eigen::Quaterniond(model_.O_T_EE().linear());
  }

  void end(fci::Status status) {
    in_motion_ = false;
    rest();
    answer(move_id_, fci::Command::kMove, status, success_delay);
  }

  // One cycle of the robot, with the command for the state before if there was one.
  void tick() {
    const bool commanded = std::exchange(commanded_, false);
    if (!commanded) ++silence_;
    if (in_motion_) {
      if (!commanded) ++uncommanded;
      if (commanded || begun_) follow(commanded);
      lost_ |= begun_ && !commanded;
      begun_ |= commanded;
      const bool finished = commanded && (command.motion_generation_finished || command.torque_command_finished);
      if (finished && !ending_) {
        const bool reference_moves = v_.norm() > 1e-6 || linear_.v.norm() > 1e-6 || angular_.v.norm() > 1e-6;
        if (reference_moves || dq_.norm() > 0.05) finished_while_moving = true;
        if (success_first) {
          answer(move_id_, fci::Command::kMove, fci::Status::kSuccess, 0);
          ending_ = true;  // idle shows in the next state
          return;
        }
        end(fci::Status::kSuccess);
      } else if (ending_) {
        ending_ = false;
        in_motion_ = false;
        rest();
      }
    } else if (start_in_ > 0 && --start_in_ == 0) {
      in_motion_ = true;
      start_in_ = -1;
      if (moved.torque()) q_d_ = q_ += std::exchange(yields, Vector7::Zero());
    }
    if (fail_to_) {
      if (in_motion_) end(fci::Status::kReflexAborted);
      start_in_ = -1;
      state.robot_mode = *fail_to_;
      if (*fail_to_ == fci::RobotMode::kReflex) {
        state.errors[static_cast<std::size_t>(error_)] = true;
        state.reflex_reason[static_cast<std::size_t>(error_)] = true;
      }
      fail_to_.reset();
    }
    if (recover_in_ > 0 && --recover_in_ == 0) {
      state.errors = {};
      state.robot_mode = fci::RobotMode::kIdle;
    }
  }

  static void worst(double& share, double value, double limit) { share = std::max(share, std::abs(value) / limit); }

  void follow(bool commanded) {
    const fci::MotionGeneratorMode generator = moved.generator;
    if (commanded && moved.torque()) {
      const Vector7 tau = Vector7::Map(command.tau_J_d.data());
      for (int i = 0; i < 7; ++i) {
        worst(worst_torque, tau[i], limits.tau_max[i]);
        worst(worst_torque_rate, (tau[i] - tau_[i]) / kDt, limits.dtau_max[i]);
      }
      tau_ = tau;
    }
    if (generator == fci::MotionGeneratorMode::kJointPosition) {
      if (commanded) {
        const Vector7 q = Vector7::Map(command.q_c.data());
        const Vector7 v = (q - q_d_) / kDt, a = (v - v_) / kDt, j = (a - a_) / kDt;
        for (int i = 0; i < 7; ++i) {
          // Rounding of a state in float32 looks like 1e-4 rad/s.
          const double v_max = v[i] > 0 ? limits.dq_upper(i, q[i]) : -limits.dq_lower(i, q[i]);
          if (std::abs(v[i]) > 1e-3) worst(worst_velocity, v[i], std::max(v_max, 1e-9));
          worst(worst_acceleration, a[i], limits.ddq_max[i]);
          worst(worst_jerk, j[i], limits.dddq_max[i]);
          beyond = std::max({beyond, q[i] - limits.q_max[i], limits.q_min[i] - q[i]});
        }
        q_d_ = q, v_ = v, a_ = a;
        if (!begun_) v_.setZero(), a_.setZero();  // the motion begins there
      } else {
        v_ += kDt * a_;
        q_d_ += kDt * v_;
      }
      q_ = q_d_;
      dq_ = v_;
    } else if (generator == fci::MotionGeneratorMode::kCartesianPosition) {
      const Eigen::Matrix4d T = Eigen::Matrix4d::Map(command.O_T_EE_c.data());
      const Eigen::Quaterniond R(Eigen::Matrix3d(T.topLeftCorner<3, 3>()));
      const Vector3 turn = realtime::log(R * orientation_.conjugate());
      linear_.see(commanded, T.topRightCorner<3, 1>() - position_, limits.translation, *this);
      angular_.see(commanded, turn, limits.rotation, *this);
      position_ += kDt * linear_.v;
      orientation_ = (realtime::exp(kDt * angular_.v) * orientation_).normalized();
      if (!begun_) linear_ = angular_ = {};
    } else {  // torque alone
      if (commanded) {
        for (int i = 0; i < 7; ++i) worst(worst_velocity, command.dq_c[i], 1e-12);  // rides along up to version 9: zero
      }
      model_.update(q_, dq_);
      realtime::Matrix7 M = model_.mass();
      M.diagonal().array() += kRotors;
      dq_ += kDt * M.llt().solve(tau_ + load - model_.coriolis());
      if (locked) dq_.setZero();
      fastest = std::max(fastest, dq_.cwiseAbs().maxCoeff());
      q_ += kDt * dq_;
      q_d_ = q_;
      show_pose();
    }
  }

  struct Part {
    Vector3 v = Vector3::Zero(), a = Vector3::Zero();
    void see(bool commanded, const Vector3& delta, const models::Limits::Rates& limits, MockRobot& robot) {
      if (!commanded) {
        v += kDt * a;
        return;
      }
      const Vector3 v1 = delta / kDt, a1 = (v1 - v) / kDt, j1 = (a1 - a) / kDt;
      worst(robot.worst_velocity, v1.norm(), limits.velocity);
      worst(robot.worst_acceleration, a1.norm(), limits.acceleration);
      worst(robot.worst_jerk, j1.norm(), limits.jerk);
      v = v1, a = a1;
    }
  };

  void show() {
    const auto put = [](const Vector7& from, fci::Vector7& to) { Vector7::Map(to.data()) = from; };
    put(q_ + yields, state.q);
    put(q_d_, state.q_d);
    put(dq_, state.dq);
    put(v_, state.dq_d);
    put(a_, state.ddq_d);
    put(tau_, state.tau_J_d);
    state.control_command_success_rate = !in_motion_ || !begun_ ? 0 : lost_ ? 0.99 : 1;
    Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
    T.topLeftCorner<3, 3>() = orientation_.toRotationMatrix();
    T.topRightCorner<3, 1>() = position_;
    Eigen::Matrix4d::Map(state.O_T_EE.data()) = T;
    Eigen::Matrix4d::Map(state.O_T_EE_c.data()) = stale_pose && !commanded_once_ ? *stale_pose : T;
    Eigen::Matrix4d::Map(state.O_T_EE_d.data()) = T;
    realtime::Vector6::Map(state.O_dP_EE_c.data()) << linear_.v, angular_.v;
    state.motion_generator_mode = in_motion_ ? moved.generator : fci::MotionGeneratorMode::kIdle;
    state.controller_mode = in_motion_ ? moved.controller : fci::ControllerMode::kJointImpedance;
    if (in_motion_) {
      state.robot_mode = fci::RobotMode::kMove;
    } else if (state.robot_mode == fci::RobotMode::kMove) {
      state.robot_mode = fci::RobotMode::kIdle;
    }
  }

  struct Due {
    robot::Answer answer;
    std::uint64_t due;  // message_id
  };

  realtime::Model model_;
  fci::Version version_;
  std::array<std::byte, fci::kMaxStateSize> bytes_;
  std::array<Due, 64> answers_;
  std::size_t answer_count_ = 0;
  std::uint32_t last_id_ = 100, move_id_ = 0;
  std::size_t next_tick_ = 0;
  int start_in_ = -1, recover_in_ = -1, silence_ = 0;
  bool begun_ = false, lost_ = false;  // a command has come since the last Move; after which another has not
  bool in_motion_ = false, commanded_ = false, commanded_once_ = false, ending_ = false;
  std::optional<fci::RobotMode> fail_to_;
  fci::Error error_{};

  Vector7 q_, dq_, q_d_, v_, a_, tau_;
  Vector3 position_;
  Eigen::Quaterniond orientation_;
  Part linear_, angular_;
};

}  // namespace testing_tools
