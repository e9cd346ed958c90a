#pragma once

#include <bitset>
#include <optional>

#include "models/arm.hpp"
#include "sim/arm_model.hpp"
#include "sim/checks.hpp"
#include "sim/internal_controller.hpp"
#include "sim/motion_generator.hpp"
#include "sim/rigid_body.hpp"
#include "sim/world.hpp"
#include "wire/fci/robot_command.hpp"
#include "wire/fci/service.hpp"

namespace sim {

// The robot between its sockets and its joints: modes, settings, the motion that runs, errors, the torque
// of each cycle and the state that it reports. A cycle is control() with the command that came for the
// state last reported, one step of the world, and sense().
//
//   kIdle ──Move──► kMoving ──finish flag, at rest──► kIdle
//                      ├──StopMove──► kStopping ──at rest──► kIdle
//                      └──error──► kReflex ──AutomaticErrorRecovery──► kRecovering ──► kIdle
class Robot {
 public:
  explicit Robot(const models::Arm& arm);

  // Limits are those of the system that speaks this version.
  void set_version(fci::Version version);

  // --- requests -----------------------------------------------------------------------------------------------

  // kMotionStarted, or why not. What becomes of the motion is told by outcome().
  fci::Status start(const fci::Move& request);
  // Brings a motion to rest; kPreempted is its outcome.
  void stop();
  // Leaves kReflex, when the arm is at rest. kNotPossible during a motion; kSuccess: it has begun, or there was
  // nothing to recover from. recovering() tells when it is over.
  fci::Status recover();
  // The client is gone: a motion ends as one whose commands stay out.
  void abandon();

  // Settings: kSuccess, kInvalidArgument, or kNotPossible in any mode but idle.
  fci::Status set(const fci::SetCollisionBehavior& request);
  fci::Status set(const fci::SetJointImpedance& request);
  fci::Status set(const fci::SetCartesianImpedance& request);
  fci::Status set(const fci::SetGuidingMode& request);
  fci::Status set(const fci::SetEEToK& request);
  fci::Status set(const fci::SetNEToEE& request);
  fci::Status set(const fci::SetLoad& request);
  fci::Status set(const fci::SetFilters& request);

  // --- the cycle ----------------------------------------------------------------------------------------------

  // Whether this is the command of the cycle that runs: it echoes the newest state, and that state is younger
  // than the motion. Anything else is late, or meant for an earlier motion.
  bool takes(const fci::RobotCommand& command);
  // A motion whose client has begun to command it: from here on a cycle without a command has lost it.
  bool awaits_command() const { return phase_ == Phase::kMoving && motion_.begun; }

  // Motor torques (N m) of the cycle; nullptr: no command came.
  Vector7 control(const fci::RobotCommand* command);
  // What the sensors say at the end of the cycle, and with it the next state.
  void sense(const Truth& truth);

  const fci::RobotState& state() const { return state_; }
  bool moving() const { return phase_ == Phase::kMoving || phase_ == Phase::kStopping; }
  bool recovering() const { return phase_ == Phase::kRecovering; }
  // How the last motion ended; empty while one runs or before the first.
  std::optional<fci::Status> outcome() const { return outcome_; }

 private:
  using Vector = Eigen::Matrix<double, 7, 1>;
  enum class Phase { kIdle, kMoving, kStopping, kReflex, kRecovering };
  struct Motion {
    fci::ControllerMode controller = fci::ControllerMode::kJointImpedance;
    fci::MotionGeneratorMode generator = fci::MotionGeneratorMode::kIdle;
    std::uint64_t accepted_at = 0;  // message_id of the state that was the newest
    bool begun = false;             // a command for it has been seen
    int lost = 0;                   // consecutive cycles without a command
    std::bitset<100> received;      // of the last commands; newest at 0
    std::size_t cycles = 0;         // since it began
  };

  bool external() const { return motion_.controller == fci::ControllerMode::kExternal; }
  void follow(fci::RobotCommand command);
  void lose();
  void count(bool received);
  void filter(fci::RobotCommand& command);
  void finish();
  void end(fci::Status outcome);
  void reflex(fci::Error error, fci::Status outcome = fci::Status::kReflexAborted);
  void rest_at(const Vector& q);
  void begin_braking();
  void brake();
  Vector law();
  void configure();
  void report();

  const models::Arm& arm_;
  fci::Version version_ = fci::kNewestVersion;
  const models::Limits* limits_;
  ArmModel model_;          // at the measured joints
  ArmModel desired_model_;  // at the desired ones; kinematics only
  InternalController internal_;
  MotionGenerator generator_;

  // Settings.
  fci::SetCollisionBehavior collision_;
  fci::SetFilters filters_;
  RigidBody end_effector_, load_;
  Eigen::Matrix4d F_T_NE_, NE_T_EE_ = Eigen::Matrix4d::Identity(), F_T_EE_;

  Phase phase_ = Phase::kIdle;
  Motion motion_;
  std::optional<fci::Status> outcome_;
  int recovery_ = 0;  // cycles left
  fci::ControllerMode holding_ = fci::ControllerMode::kJointImpedance;  // the law while nothing moves
  MotionGenerator::Desired desired_;
  fci::RobotCommand last_command_;
  Vector tau_J_d_ = Vector::Zero();

  // Measured.
  Vector q_, dq_ = Vector::Zero(), tau_J_ = Vector::Zero(), dtau_J_ = Vector::Zero();
  Vector tau_ext_ = Vector::Zero();
  bool sensed_ = false;

  fci::RobotState state_;
};

}  // namespace sim
