#pragma once

#include "models/arm.hpp"
#include "realtime/back_off.hpp"
#include "realtime/door.hpp"
#include "realtime/model.hpp"
#include "realtime/momentum_observer.hpp"
#include "realtime/motion_gate.hpp"
#include "realtime/part_watch.hpp"
#include "realtime/path_clock.hpp"
#include "realtime/rejoin.hpp"
#include "realtime/robot_controllers/robot_controller.hpp"
#include "realtime/robot_settings.hpp"
#include "realtime/tick.hpp"
#include "realtime/torque_gate.hpp"
#include "realtime/trajectories/min_jerk.hpp"
#include "robot/driver.hpp"

namespace realtime {

// The 1 kHz loop of one arm. It lives in its own thread, owns the driver's every call, and goes on
// whatever comes through the door or from the robot; it ends when the door says quit or the
// connection is lost.
class Loop {
 public:
  struct Options {
    double hold_time = 2.0;    // s that a motion is kept with nothing to do before it is finished
    robot::Settings settings;  // in force for each motion (tool, load, thresholds) unless its skill says otherwise
    PartWatch::Hooks watch;
  };

  // All must outlive the loop.
  Loop(robot::Driver& driver, Model& model, const models::Limits& limits, const Options& options,
       Door& door);
  ~Loop();
  Loop(const Loop&) = delete;

  // Cycles until the end; false when the connection was lost.
  bool run() noexcept;

  // One cycle; false when there will be no other.
  bool cycle() noexcept;

 private:
  // The steps of a cycle, in order.
  bool receive() noexcept;
  void observe() noexcept;
  void take_answers() noexcept;
  void take_walls() noexcept;
  void take_bounds() noexcept;
  void watch_robot() noexcept;
  void change_skill() noexcept;
  void prepare_motion() noexcept;
  void feel_contact() noexcept;
  void generate_reference() noexcept;
  void exert() noexcept;
  void pace_path() noexcept;
  bool arm_is_ours() const noexcept;
  Vector7 lead(const Reference& reference) const noexcept;
  double away() const noexcept;
  bool keep_near_arm() noexcept;
  void compute_torque() noexcept;
  void send_command() noexcept;
  void terminate_skill() noexcept;
  void publish() noexcept;

  // Skills: each comes through the door once, gets one result, and is retired once.
  void end(Skill* skill, Ending ending) noexcept;
  Left left(const Skill& skill) const noexcept;
  double duration(const Skill& skill) const noexcept;
  bool has_end(const Skill& skill) const noexcept;
  std::optional<Vector7> posture() const noexcept;
  void drop_next(Ending ending, fci::Command refused = fci::Command::kMove,
                 fci::Status status = fci::Status::kSuccess) noexcept;
  void stop_running(Ending ending, int termination = -1) noexcept;
  void post_result(SkillResult result, const Skill& skill) noexcept;
  int ask_terminations(bool of_contact) noexcept;
  void end_softly(SoftEnding& ending) noexcept;
  void lose_connection() noexcept;
  void start_skill() noexcept;
  void start_trajectory(double speed_before) noexcept;
  void start_terminations() noexcept;
  void begin_to_listen() noexcept;
  void place_joints() noexcept;
  void start_controller(bool move_reference) noexcept;
  void step_controller(Vector7& tau) noexcept;
  void change_parts() noexcept;
  bool waits_for_start() const noexcept;
  const Reference& followed() noexcept;
  void take_over() noexcept;
  bool go_on_from_arm() noexcept;
  void change_motion(Channels motion) noexcept;
  bool fits_motion(const Skill& skill) const noexcept;
  bool next_waits() const noexcept;
  bool may_begin() const noexcept;
  bool follows_failure(const Skill& skill) const noexcept;
  void hold() noexcept;
  void leave_motion() noexcept;

  // The robot's side.
  void configure() noexcept;
  void start_motion(bool release = false) noexcept;
  void begin_motion() noexcept;
  void begin_time() noexcept;
  void begin_again() noexcept;
  bool would_leap() const noexcept;
  void let_go() noexcept;
  void end_motion(Phase phase) noexcept;
  void fail_motion() noexcept;
  void recover(std::uint64_t seen) noexcept;
  void answer_recovery(bool recovered, fci::Status status, bool unseen = false) noexcept;
  bool robot_idle() const noexcept;
  bool robot_matches() const noexcept;
  bool in_motion() const noexcept;
  bool commands_were_lost() noexcept;
  void update_tool() noexcept;
  void set_deadline(std::uint64_t milliseconds) noexcept { deadline_ = state_.message_id + milliseconds; }
  bool overdue() const noexcept { return state_.message_id >= deadline_; }

  robot::Driver& driver_;
  Model& model_;
  const Options options_;
  Door& door_;
  MotionGate gate_;
  TorqueGate torque_gate_;

  Phase phase_ = Phase::kConnecting;
  std::uint64_t deadline_ = 0;  // message_id at which waiting for the robot ends
  bool quit_ = false;           // from the door
  bool ended_ = false;          // no other cycle
  bool lost_ = false;           // the connection
  bool user_stopped_ = false;   // after skills had come: released or not, the arm waits for recover()

  // What the robot says.
  fci::RobotState state_;
  fci::RobotState tool_state_;  // whose tool the model has
  std::uint64_t ticks_ = 1;     // ms since the last state
  std::uint64_t cycles_ = 0, lost_states_ = 0;
  std::uint64_t error_began_ = 0;  // the cycle of the newest
  MomentumObserver observer_;
  Cycle cycle_{state_, model_};

  // Skills.
  Skill* next_ = nullptr;    // waits for a motion of its own
  Change* change_ = nullptr;  // for a skill that runs, or has not begun
  std::uint64_t newest_ = 0;  // id of the last skill that came through the door
  Skill* skill_ = nullptr;   // runs, or is braked to its end
  Skill* holder_ = nullptr;  // whose controller commands: skill_, or the last one
  PartWatch watch_;          // of their parts
  Ending ending_ = Ending::kTerminated;  // of skill_, once it is at rest
  int termination_ = -1;
  AfterContact after_contact_ = AfterContact::kNoContact;  // of a contact that has ended it
  Vector3 touched_at_ = Vector3::Zero();                   // of EE, m, when that was noticed
  BackOff back_off_;
  double skill_time_ = 0;    // s
  PathClock path_;         // of its trajectory
  double slowed_ = 0;      // s that limits have made it longer
  double trajectory_began_ = 0;  // s of skill time
  bool waited_ = false;    // for an arm that was held
  bool held_back_ = false;  // by limits, in the step before
  bool trajectory_over_ = false;
  bool faulty_ = false;      // the holder's controller is at fault, or there is none, and it is not asked
  int begins_for_ = 0;       // cycles at most, in which the first command of a motion may be found not to have come
  Vector7 begins_at_ = Vector7::Zero();  // rad, q_d before it
  bool begins_ = false;      // anew, with this cycle's command
  bool releases_ = false;    // the motion that starts only lets the arm go where it is
  bool released_ = false;    // for the waiting skill there was one
  std::uint64_t unfinished_ = 0;  // id of the last skill that did not end by itself
  std::uint64_t limited_cycles_ = 0;
  std::uint64_t skill_lost_states_ = 0;
  double success_rate_ = 1;  // of the last commands, as the robot last said while a motion was active
  std::int64_t first_command_ns_ = 0;  // 0: not yet
  bool leaving_ = false;     // no skill, and the motion is to be finished as soon as the arm rests
  std::uint64_t hold_until_ = 0;  // message_id

  // What is commanded.
  robot::Mode mode_, wire_mode_;  // of the motion; as the robot names it
  const RobotController* robot_ = &robot_controller(robot::kTorque);
  Reference wanted_, reference_;  // before and after the limits
  Reference joints_of_robot_;     // that it moves along with a pose
  bool coasted_ = false;          // in this cycle the robot went on by itself
  Rejoin rejoin_;                 // after that
  HeldBy held_by_ = HeldBy::kNothing;        // in this cycle
  HeldBy skill_held_by_ = HeldBy::kNothing;  // since the running skill began
  Vector7 tau_J_d_ = Vector7::Zero();
  Vector7 held_ = Vector7::Zero();  // N m, by which an arm is held whose controller is not asked
  Vector7 caught_ = Vector7::Zero();  // rad, where it is held
  MinJerk<7> left_over_;   // torque by which the controller would have stepped when it began, on its way to zero
  double fade_time_ = 1;   // s that it has been on it
  fci::RobotCommand command_;
  bool sent_ = false;             // in this cycle
  std::uint64_t commanded_skill_ = 0;  // its id, in this cycle; 0: none
  std::int64_t compute_ns_ = 0;

  // Requests whose answers are awaited.
  RobotSettings settings_;  // asked for once before any motion too, so that reads are right
  std::optional<std::uint32_t> move_id_, recovery_id_;
  std::uint64_t move_again_ = 0;  // message_id before which it is not asked for again
  bool recovery_accepted_ = false;
  bool stop_sent_ = false;
  std::optional<fci::Status> motion_answer_;  // the end of the motion, before the states show it
  std::uint64_t motion_answer_until_ = 0;     // message_id
};

}  // namespace realtime
