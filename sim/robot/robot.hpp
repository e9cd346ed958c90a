#pragma once

#include <bitset>
#include <optional>

#include "models/arm.hpp"
#include "sim/robot/arm_model.hpp"
#include "sim/robot/asynchronous_motion.hpp"
#include "sim/robot/checks.hpp"
#include "sim/robot/contact_detection.hpp"
#include "sim/robot/external_force.hpp"
#include "sim/robot/guiding.hpp"
#include "sim/robot/internal_controller.hpp"
#include "sim/robot/motion_generator.hpp"
#include "sim/robot/sensors.hpp"
#include "sim/robot/settings.hpp"
#include "sim/world/world.hpp"
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
//   any ──user stop, enabling device released, joints locked──► kHalted ──all undone──► kIdle
//                                                kHalted ◄──guiding buttons──► kGuiding
class Robot {
 public:
  // ideal: sensors without noise; else the seed makes it.
  explicit Robot(const models::Arm& arm, bool ideal = false, std::uint64_t seed = 1);

  // Limits are those of the system that speaks this version.
  void set_version(fci::Version version);

  // --- requests -----------------------------------------------------------------------------------------------

  // kMotionStarted, or why not. What becomes of the motion is told by outcome().
  fci::Status start(const fci::Move& request);
  // Brings a motion to rest; kPreempted is its outcome.
  void stop();
  // Leaves kReflex, when the arm is at rest. kSuccess: it has begun, or there was nothing to recover from; else why
  // not. recovering() tells when it is over, recovered() how it ended.
  fci::Status recover();
  // The client is gone: a motion ends as one whose commands stay out.
  void abandon();

  // Settings: kSuccess, kInvalidArgument, or why not now; only an idle robot takes them.
  template <class Request>
  fci::Status set(const Request& request) {
    if (!Settings::valid(request)) return fci::Status::kInvalidArgument;
    if (const auto refusal = why_not_now()) return *refusal;
    settings_.take(request);
    configure();
    return fci::Status::kSuccess;
  }

  const Settings& settings() const { return settings_; }
  // Those that clients have made of another moment of this robot.
  void keep(const Settings& settings) {
    if (settings == settings_) return;
    settings_ = settings;
    configure();
  }

  // --- people at the robot ------------------------------------------------------------------------------------

  // The external activation device. Pressed, it stops the arm, and a motion ends with kEmergencyAborted; let go, it has
  // reset the errors.
  void user_stop(bool pressed);
  // The enabling device of an FR3, held unless said otherwise. Let go, it stops the arm as a safety function does: from
  // version 6 on with the statuses for it, before as the user stop.
  void enabling_device(bool held);
  // Brakes of the joints closed, as after power-on; no more than asking for it while something moves.
  void lock(bool locked);
  // The guiding buttons at the hand. They take effect while the user stop is pressed and once the arm rests, as on the robot.
  void guide(bool pressed);
  // What is set up in the robot's own user interface: cuboids that the arm must not enter, by a number of theirs.
  void set_virtual_wall(int id, const VirtualWall& wall) {
    checks_.set_wall(id, wall, external() ? model_ : generator_.model());
  }
  VirtualWall virtual_wall(int id) const { return checks_.walls().get(id); }
  // Raises an error as if there were reason to.
  void inject(fci::Error error);

  // --- the cycle ----------------------------------------------------------------------------------------------

  // Whether this is the command of the cycle that runs: it echoes the newest state, and that state is younger
  // than the motion. Anything else is late, or meant for an earlier motion. In an asynchronous motion the state may be
  // any since the last command.
  bool takes(const fci::RobotCommand& command);
  // The same, of a command that may yet be lost on its way.
  bool expects(const fci::RobotCommand& command) const;
  // A motion whose client has begun to command it: from here on a cycle without a command has lost it.
  bool awaits_command() const { return phase_ == Phase::kMoving && motion_.begun && !motion_.asynchronous; }
  // A motion to the newest target, whose commands come when they come.
  bool asynchronous() const { return phase_ == Phase::kMoving && motion_.asynchronous; }

  // Motor torques (N m) of the cycle; nullptr: no command came.
  Vector7 control(const fci::RobotCommand* command);
  // What the sensors say at the end of the cycle, and with it the next state.
  void sense(const Truth& truth);

  // A cycle in which the world stands still: time, requests and modes go on, and nothing is felt.
  void stand_still();
  // Whether the world must go on for what the robot does: a motion that its client commands, braking, guiding.
  bool under_way() const;
  // Ids never go back, whatever moment this robot is a copy of.
  void continue_from(std::uint64_t message_id) { state_.message_id = message_id; }

  const fci::RobotState& state() const { return state_; }
  bool moving() const { return phase_ == Phase::kMoving || phase_ == Phase::kStopping; }
  bool recovering() const { return phase_ == Phase::kRecovering; }
  fci::Status recovered() const { return recovered_; }
  // How the last motion ended; empty while one runs or before the first.
  std::optional<fci::Status> outcome() const { return outcome_; }

 private:
  using Vector = Eigen::Matrix<double, 7, 1>;
  enum class Phase { kIdle, kMoving, kStopping, kReflex, kRecovering, kHalted, kGuiding };
  struct Motion {
    fci::ControllerMode controller = fci::ControllerMode::kJointImpedance;
    fci::MotionGeneratorMode generator = fci::MotionGeneratorMode::kIdle;
    bool asynchronous = false;
    bool finishing = false;         // asynchronous: ends once it has arrived
    std::uint64_t accepted_at = 0;  // message_id of the state that was the newest
    std::uint64_t echoed = 0;       // asynchronous: of the state that the last command answers
    bool begun = false;             // a command for it has been seen
    bool commanded = false;         // one has been followed
    int lost = 0;                   // consecutive cycles without a command
    std::bitset<100> received;      // of the last commands; newest at 0
    std::size_t cycles = 0;         // since it began
  };

  bool external() const { return motion_.controller == fci::ControllerMode::kExternal; }
  void advance_phase(const fci::RobotCommand* command);
  void follow(fci::RobotCommand command);
  void follow_target(const fci::RobotCommand* command);
  void lose();
  bool advance(const fci::RobotCommand* command, bool first = false);
  void count(bool received);
  void filter(fci::RobotCommand& command);
  void finish();
  void end(fci::Status outcome);
  void reflex(fci::Error error, fci::Status outcome = fci::Status::kReflexAborted);
  bool reflex(const fci::Errors& errors);
  std::optional<fci::Status> why_not_now() const;
  void obey_stops();
  void obey_guiding();
  void react();
  void clear_errors();
  void rest_at(const Vector& q);
  void begin_braking(bool from_reference);
  void brake();
  Vector law();
  void configure();
  void report();

  fci::Version version_ = fci::kNewestVersion;
  Checks checks_;
  ArmModel model_;          // at the measured joints
  ArmModel desired_model_;  // at the desired ones; kinematics only
  InternalController internal_;
  MotionGenerator generator_;
  AsynchronousMotion asynchronous_;

  Settings settings_;
  Eigen::Matrix4d F_T_EE_;  // of the settings

  Phase phase_ = Phase::kIdle;
  Motion motion_;
  std::optional<fci::Status> outcome_;
  int recovery_ = 0;  // cycles left
  fci::Status recovered_ = fci::Status::kSuccess;
  bool user_stop_ = false, enabled_ = true, locked_ = false, guide_ = false;
  fci::ControllerMode holding_ = fci::ControllerMode::kJointImpedance;  // the law while nothing moves
  MotionGenerator::Desired desired_;
  fci::RobotCommand last_command_;
  Vector tau_J_d_ = Vector::Zero(), tau_motor_ = Vector::Zero();

  Sensors sensors_;
  ExternalForce external_force_;
  ContactDetection contact_;
  Guiding guiding_;
  bool sensed_ = false;

  fci::RobotState state_;
};

}  // namespace sim
