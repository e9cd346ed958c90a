#include "realtime/loop.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <utility>

#include "realtime/base_gravity.hpp"
#include "realtime/rotation.hpp"
#include "realtime/tool.hpp"

namespace realtime {
namespace {

constexpr std::uint64_t kAnswerTime = 1000;     // ms for the robot to answer a request or to change its modes
constexpr std::uint64_t kRecoveryTime = 10000;  // ms: brakes are opened on the way
constexpr std::uint64_t kMoveAgain = 20;        // ms after which a motion that was not possible is asked for again
constexpr std::uint64_t kAnswerLead = 20;       // ms by which the answer to Move may precede its state
constexpr double kRateOver = 100;               // commands that the robot's control_command_success_rate is of
constexpr std::size_t kDoorRoom = 4;            // results and skills that one more skill may send back at once

// Finishing a motion while the arm moves is a reflex; under torque control it may still swing when the reference rests.
constexpr std::uint64_t kSettlingTime = 1000;  // ms after which it is damped until it rests
constexpr std::uint64_t kDampedTime = 2000;    // ms after which one that does not is given to the robot, to stop it by itself

// Torque that brings an arm to rest whose controller has failed, or does not hold it: damping, N m s/rad. What then still drifts
// has a load that the robot does not know, and is caught by a spring, N m/rad.
const Vector7 kFaultDamping = (Vector7() << 20, 20, 20, 20, 5, 5, 5).finished();
const Vector7 kFaultStiffness = 5 * kFaultDamping;

// rad that an arm is away from its reference: from where on its path goes slower, and where it waits. Soft controllers lag and
// are loaded.
constexpr double kLagging = 0.15, kHeld = 0.3;
constexpr double kReach = 0.5;  // m that a tool moves when a joint turns by a radian, about
constexpr double kStill = 0.1;  // rad/s of an arm that is held, and does not only lag
constexpr std::int64_t kSoon = 1'000'000'000;  // ns to a skill's start time, for which the motion before is held on

// Torque by which the robot's own law may leap when a motion begins, a share of what a joint can give.
constexpr double kLeap = 0.2;

constexpr double kFadeTime = 0.1;       // s in which a difference of torque fades away, at least
constexpr double kFadePerTorque = 0.3;  // s more, where it is more than a joint can give: for each time of that
constexpr double kLongestFade = 5;      // s
constexpr double kEffortDecay = 0.98;    // a cycle, of what was exerted beside a motion and no longer is

std::int64_t now_ns() {
  timespec now;
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1'000'000'000ll + now.tv_nsec;
}

Vector7 vector(const fci::Vector7& values) { return Vector7::Map(values.data()); }

// Of a motion: by an error.
bool is_aborted(fci::Status status) {
  using enum fci::Status;
  return status == kReflexAborted || status == kEmergencyAborted || status == kInputErrorAborted || status == kAborted;
}

// How far the reference is behind what is wanted, by what lets a path wait.
double lag(const Reference& wanted, const Reference& reference) {
  constexpr double kJoint = 0.05, kPosition = 0.03, kAngle = 0.1;  // rad, m, rad
  if (wanted.motion != reference.motion || !is_finite(wanted)) return 0;
  if (wanted.motion == Channels::kJoint) return (wanted.joint.q - reference.joint.q).cwiseAbs().maxCoeff() / kJoint;
  const Vector6 way = change_between(reference.cartesian, wanted.cartesian);
  return std::max(way.head<3>().norm() / kPosition, way.tail<3>().norm() / kAngle);
}

// A part of one's own may not say which motion it makes, and have a quaternion that is only about one; none at all is not finite.
void tidy(Reference& reference, Channels motion) {
  constexpr double kRounding = 1e-9, kAbout = 0.1;
  reference.motion = motion;
  if (motion == Channels::kJoint) return;
  const double off = std::abs(reference.cartesian.orientation.norm() - 1);
  if (off > kAbout) reference.cartesian.orientation.coeffs().setConstant(std::numeric_limits<double>::quiet_NaN());
  if (off > kRounding) reference.cartesian.orientation.normalize();
}

}  // namespace

Loop::Loop(robot::Driver& driver, Model& model, const models::Limits& limits, const Options& options, Door& door)
    : driver_(driver),
      model_(model),
      options_(options),
      door_(door),
      gate_(limits, model),
      torque_gate_(limits),
      watch_(options.watch),
      rejoin_(limits),
      settings_(options.settings) {
  left_over_.set_duration(kFadeTime);
  tool_state_.m_ee = -1;  // so that the first state's is taken
}

Loop::~Loop() {
  if (holder_ != skill_) delete holder_;
  delete skill_;
  delete next_;
  delete change_;
}

bool Loop::run() noexcept {
  while (cycle()) {
  }
  return !lost_;
}

bool Loop::cycle() noexcept {
  if (!receive()) return false;
  observe();
  take_answers();
  take_walls();
  take_bounds();
  watch_robot();
  begin_again();
  change_skill();
  prepare_motion();
  if (in_motion()) {
    feel_contact();
    generate_reference();
    compute_torque();
  }
  send_command();
  terminate_skill();
  publish();
  return !ended_;
}

// --- steps of a cycle ----------------------------------------------------------------------------------------------

bool Loop::receive() noexcept {
  const std::uint64_t last = state_.message_id;
  if (driver_.receive(state_) != robot::Received::kState) {
    lost_ = true;
    lose_connection();
    return false;
  }
  door_.robot_time.store(state_.message_id, std::memory_order_relaxed);
  ticks_ = cycles_ == 0 ? 1 : state_.message_id - last;
  lost_states_ += ticks_ - 1;
  skill_lost_states_ += ticks_ - 1;
  if (in_motion() && ticks_ > RobotController::kMostLost + 1) ticks_ = 1;  // if the motion goes on, the clock has leapt
  ++cycles_;
  return true;
}

void Loop::observe() noexcept {
  update_tool();
  cycle_.q = vector(state_.q);
  cycle_.dq = vector(state_.dq);
  cycle_.O_T_EE = pose(state_.O_T_EE);
  cycle_.dt = static_cast<double>(ticks_) * kTick;
  cycle_.tau_J_d = tau_J_d_;
  model_.update(cycle_.q, cycle_.dq);
  observer_.update(state_, model_, ticks_);
  cycle_.q_ref = gate_.joints().q;
  cycle_.dq_ref = gate_.joint_velocity();
  held_by_ = HeldBy::kNothing;
  coasted_ = in_motion() && commands_were_lost();
  if (in_motion() && robot_matches()) success_rate_ = state_.control_command_success_rate;
}

void Loop::take_answers() noexcept {
  while (const auto answer = driver_.poll()) {
    if (answer->id == recovery_id_) {
      recovery_id_.reset();
      if (answer->status == fci::Status::kSuccess) {
        recovery_accepted_ = true;  // complete when the robot is idle
      } else {
        answer_recovery(false, answer->status);
      }
    } else if (answer->id == move_id_) {
      if (answer->status == fci::Status::kMotionStarted) continue;
      move_id_.reset();
      if (phase_ == Phase::kStarting && answer->status == fci::Status::kNotPossible && !overdue()) {
        move_again_ = state_.message_id + kMoveAgain;  // the motion before may not be over on the robot's side
      } else if (phase_ == Phase::kStarting && is_aborted(answer->status) && !overdue()) {
        move_again_ = std::numeric_limits<std::uint64_t>::max();  // a state is to come that says by which error
      } else if (phase_ == Phase::kStarting) {
        phase_ = Phase::kIdle;
        drop_next(Ending::kRefused, fci::Command::kMove, answer->status);
      } else if (in_motion()) {
        motion_answer_ = answer->status;
        motion_answer_until_ = state_.message_id + kAnswerLead;
      }
    } else if (settings_.take(*answer) && answer->status != fci::Status::kSuccess && phase_ == Phase::kConfiguring) {
      phase_ = Phase::kIdle;
      drop_next(Ending::kRefused, answer->command, answer->status);
    }
  }
}

void Loop::watch_robot() noexcept {
  const bool takes_motions =
      state_.robot_mode == fci::RobotMode::kIdle || state_.robot_mode == fci::RobotMode::kMove;
  user_stopped_ |= newest_ != 0 && state_.robot_mode == fci::RobotMode::kUserStopped;
  switch (phase_) {
    case Phase::kConnecting:
    case Phase::kError:
      phase_ = robot_idle() && !user_stopped_ ? Phase::kIdle : Phase::kError;
      break;
    case Phase::kIdle:
    case Phase::kConfiguring:
      if (!robot_idle()) fail_motion();
      break;
    case Phase::kStarting:
      if (!takes_motions) fail_motion();
      break;
    case Phase::kRunning:
    case Phase::kHolding:
    case Phase::kBraking:
      if (stop_sent_) {
        if (!takes_motions) fail_motion();
        if (robot_idle()) end_motion(Phase::kIdle);
      } else if (!robot_matches() || (motion_answer_ && state_.message_id >= motion_answer_until_)) {
        fail_motion();
      }
      break;
    case Phase::kFinishing:
      if (robot_idle()) {
        end_motion(Phase::kIdle);
      } else if (!takes_motions || (overdue() && stop_sent_)) {
        fail_motion();
      } else if (overdue()) {
        stop_sent_ = driver_.post(fci::StopMove{}).has_value();
        set_deadline(kAnswerTime);
      }
      break;
    case Phase::kRecovering:
      if (recovery_accepted_ && robot_idle()) {
        answer_recovery(true, fci::Status::kSuccess);
      } else if (overdue()) {
        answer_recovery(false, fci::Status::kFailed);
      }
      break;
  }
  if (const std::uint64_t seen = door_.recover.load(std::memory_order_relaxed); seen != 0) recover(seen);
}

// The one place where a skill begins, gives way or is stopped.
void Loop::change_skill() noexcept {
  quit_ = door_.quit.load(std::memory_order_relaxed);
  const std::uint64_t stop_up_to = door_.stop_up_to.load(std::memory_order_acquire);

  const bool between = phase_ == Phase::kConfiguring || phase_ == Phase::kStarting || phase_ == Phase::kRecovering;
  if (!between && door_.results.room() >= kDoorRoom && door_.retired.room() >= kDoorRoom) {
    if (Skill* found = door_.next.take()) {
      if (next_ != nullptr) drop_next(Ending::kPreempted);
      next_ = found;
    } else if (next_ == nullptr) {
      next_ = door_.queued.take();
    }
    if (next_ != nullptr) newest_ = next_->id;
  }
  if (next_ != nullptr && phase_ != Phase::kStarting) {
    if (quit_ || next_->id <= stop_up_to) {
      if (phase_ == Phase::kConfiguring) phase_ = Phase::kIdle;
      drop_next(Ending::kStopped);
    } else if (follows_failure(*next_)) {
      drop_next(Ending::kCancelled);
    } else if (phase_ == Phase::kError) {
      drop_next(Ending::kRobotError);
    }
  }
  if (phase_ == Phase::kRunning && (quit_ || skill_->id <= stop_up_to)) stop_running(Ending::kStopped);
  if (back_off_.active() && (quit_ || skill_->id <= stop_up_to)) back_off_.stop();
  change_parts();

  if (in_motion() && next_ != nullptr && !next_waits()) {
    if (fits_motion(*next_)) {
      take_over();
      if (begins_) begin_time();
    } else if (skill_ != nullptr) {
      end(skill_, phase_ == Phase::kBraking ? ending_ : Ending::kPreempted);
    }
  }
  if (in_motion() && skill_ == nullptr) {
    const bool fits = next_ != nullptr && fits_motion(*next_);
    const bool prepares = may_begin() && !(next_waits() && fits);
    const bool begins_soon = fits && next_->start_ns - driver_.received_ns() < kSoon;
    if (prepares || quit_ || faulty_ || (state_.message_id >= hold_until_ && !begins_soon)) {
      leave_motion();
    } else if (phase_ == Phase::kBraking && gate_.at_rest()) {
      hold();  // what it was left for has been stopped
    }
  }
  if (quit_ && (phase_ == Phase::kIdle || phase_ == Phase::kError || phase_ == Phase::kRecovering)) ended_ = true;
}

// From a skill that waits to its first command: settings, Move, modes.
void Loop::prepare_motion() noexcept {
  if (phase_ == Phase::kIdle && (may_begin() || (next_ == nullptr && !settings_.asked()))) configure();
  if (phase_ == Phase::kConfiguring) {
    settings_.post(driver_);
    if (settings_.answered()) {
      phase_ = Phase::kIdle;
      if (may_begin()) start_motion();
    } else if (overdue()) {
      phase_ = Phase::kIdle;
      drop_next(Ending::kRefused, settings_.silent(), fci::Status::kFailed);
    }
  }
  if (phase_ == Phase::kStarting) {
    if (!move_id_ && state_.message_id >= move_again_) {
      fci::Move move;
      move.controller_mode = wire_mode_.controller;
      move.motion_generator_mode = wire_mode_.generator;
      move_id_ = driver_.post(move);
    }
    if (robot_matches()) {
      command_ = {};
      begin_motion();
    } else if (overdue()) {
      driver_.post(fci::StopMove{});  // should it start after all
      move_id_.reset();
      phase_ = Phase::kIdle;
      drop_next(Ending::kRefused, fci::Command::kMove, move_again_ != 0 ? fci::Status::kNotPossible : fci::Status::kFailed);
    }
  }
}

// Before anything is commanded: what is measured in this cycle takes the motion away in this cycle.
void Loop::feel_contact() noexcept {
  if (phase_ != Phase::kRunning || waits_for_start()) return;
  const int termination = ask_terminations(true);
  if (termination < 0) return;
  stop_running(Ending::kTerminated, termination);
  end_softly(*skill_->terminations[static_cast<std::size_t>(termination)]->then());
}

// A reference that is ours alone rests where the arm is: what the controller then asks for is to damp it, and the torque limits
// are all that is between that and the arm. The robot's own it only brakes.
void Loop::end_softly(SoftEnding& ending) noexcept {
  after_contact_ = ending.what;
  touched_at_ = cycle_.O_T_EE.translation();
  if (ending.what == AfterContact::kBackedOff) {
    back_off_.plan(ending, reference_, -observer_.O_F_ext_K().head<3>(), cycle_.q, model_);
  }
  reference_.wrench.setZero();
  reference_.torque.setZero();
  if (!robot_->takes_torque() || robot_->has_reference()) return;
  const bool complies = ending.what == AfterContact::kComplied;
  reference_ = robot_->start(cycle_, complies ? Channels::kJoint : reference_.motion, model_);
  gate_.place(cycle_.q);
  gate_.reset(reference_);
  fade_time_ = left_over_.duration();
  if (!complies) return skill_->controller->stay();
  std::swap(skill_->controller, ending.law);
  skill_->numbers.controller = 0;
  Reference unmoved = reference_;
  skill_->controller->start(cycle_, unmoved);
}

void Loop::generate_reference() noexcept {
  int steps = robot_->pass(static_cast<int>(ticks_), gate_.limiter(), reference_);
  coasted_ |= robot_->has_reference() && ticks_ > 1;
  if (coasted_) gate_.strayed();
  const Vector7 q_d = vector(state_.q_d);
  gate_.prefer(phase_ == Phase::kRunning ? posture() : std::nullopt);
  gate_.observe(reference_, model_.gravity(base_gravity(state_)), robot_->makes_joints() ? &q_d : nullptr);
  if (phase_ == Phase::kRunning && first_command_ns_ == 0) begin_to_listen();
  if (phase_ == Phase::kRunning && !waits_for_start()) {
    skill_time_ += cycle_.dt;
    cycle_.time = skill_time_;
    const auto step_trajectory = [&] {
      const bool over = watch_.step(PartWatch::kTrajectory, skill_->numbers.trajectory,
                                    [&] {
                                      const bool is_over = skill_->trajectory->step(cycle_, std::max(path_.time(), 0.), wanted_);
                                      tidy(wanted_, motion_of(skill_->trajectory->fills()));
                                      return is_over;
                                    });
      path_.slow(wanted_);
      return over;
    };
    if (coasted_) {
      path_.step(path_.share(), cycle_.dt - kTick);
      step_trajectory();
      rejoin_.start(reference_, wanted_);
    }
    for (; steps > 0; --steps) {
      pace_path();
      trajectory_over_ = step_trajectory();
      if (rejoin_.active()) rejoin_.step(kTick, wanted_);
      const bool is_near = !keep_near_arm();
      const HeldBy held = gate_.follow(wanted_, reference_);
      held_back_ = held != HeldBy::kNothing;
      held_by_ |= held;
      if ((held_back_ || !is_near) && !rejoin_.active()) {
        watch_.ask(skill_->numbers.trajectory, [&] { skill_->trajectory->held_back(reference_); });
      }
    }
    held_by_ |= when(skill_->trajectory->limited(), HeldBy::kMotionLimits);
    trajectory_over_ &= !rejoin_.active() && (!held_back_ || gate_.stuck());  // not before the reference is there as well
    trajectory_over_ |= gate_.stuck() && has_end(*skill_);       // which is as far as it goes
    exert();
    if (watch_.at_fault()) stop_running(Ending::kComponentFault);
  } else {
    cycle_.time += cycle_.dt;
    for (; steps > 0; --steps) {
      if (back_off_.active() && (back_off_.begun() || gate_.at_rest())) {
        const bool over = back_off_.step(reference_, wanted_);
        const HeldBy held = gate_.follow(wanted_, reference_);
        held_by_ |= held;
        if (gate_.stuck() || (over && held == HeldBy::kNothing && gate_.at_rest())) back_off_.stop();
      } else {
        gate_.brake(reference_, skill_ != nullptr && after_contact_ != AfterContact::kNoContact);
      }
      reference_.wrench *= kEffortDecay;
      reference_.torque *= kEffortDecay;
    }
  }
}

// What the trajectory exerts beside its motion; what the one before it has exerted fades away.
void Loop::exert() noexcept {
  if (!is_finite(wanted_)) return watch_.not_finite(PartWatch::kTrajectory, skill_->numbers.trajectory);
  const Channels fills = skill_->trajectory->fills();
  reference_.wrench = has(fills, Channels::kWrench) ? wanted_.wrench : Vector6(kEffortDecay * reference_.wrench);
  reference_.torque = has(fills, Channels::kTorque) ? wanted_.torque : Vector7(kEffortDecay * reference_.torque);
}

// One cycle on along the path: slower where the reference has fallen behind it, as the limits are in the way, and where the arm
// has fallen behind the reference, as something holds it.
void Loop::pace_path() noexcept {
  // What comes as it goes along has a clock of its own.
  const bool ends = has_end(*skill_);
  const double behind = held_back_ && ends ? lag(wanted_, reference_) : 0;
  const double held = arm_is_ours() ? std::max((away() - kLagging) / (kHeld - kLagging), 0.) : 0;
  path_.step(ends ? std::clamp(1 - std::max(behind, held), 0., 1.) : 1, kTick);
  const bool waits = held > behind && cycle_.dq.cwiseAbs().maxCoeff() < kStill;
  waited_ |= waits;
  held_by_ |= when(held > 0, HeldBy::kArm);
  if (!waits && !gate_.stuck()) slowed_ += (1 - path_.share()) * kTick;
}

// By our torques alone.
bool Loop::arm_is_ours() const noexcept {
  return robot_->takes_torque() && !robot_->has_reference() && holder_->controller->leads();
}

// How far the controller would lead the arm to be there: each joint, or the tool and its orientation; rad, a tool as far as a joint
// turns to move it so far.
Vector7 Loop::lead(const Reference& reference) const noexcept {
  const Controller& controller = *holder_->controller;
  if (reference.motion == Channels::kJoint) return controller.led_joints(reference.joint.q - cycle_.q).cwiseAbs();
  const Vector6 way = controller.led_pose(cycle_, change_between(at(cycle_.O_T_EE), reference.cartesian));
  Vector7 out = Vector7::Zero();
  out[0] = way.head<3>().norm() / kReach;
  out[1] = way.tail<3>().norm();
  return out;
}

double Loop::away() const noexcept { return lead(reference_).maxCoeff(); }

// What a stream wants does not wait for an arm that is held: what of it leads farther from the arm is left out, the more the farther
// the reference is already. Returns whether anything was.
bool Loop::keep_near_arm() noexcept {
  if (has_end(*skill_) || !arm_is_ours() || wanted_.motion != reference_.motion || !is_finite(wanted_)) return false;
  const Vector7 now = lead(reference_), then = lead(wanted_);
  const Vector7 free = (1 - (now.array() - kLagging) / (kHeld - kLagging)).max(0.).min(1.);
  const Vector7 share = (then.array() > now.array()).select(free, 1);
  if (share.minCoeff() >= 1) return false;
  if (wanted_.motion == Channels::kJoint) {
    JointReference& joint = wanted_.joint;
    joint.q = reference_.joint.q + share.cwiseProduct(joint.q - reference_.joint.q);
    joint.dq = share.cwiseProduct(joint.dq);
    joint.ddq = share.cwiseProduct(joint.ddq);
    return true;
  }
  CartesianReference& pose = wanted_.cartesian;
  const Vector6 way = change_between(reference_.cartesian, pose);
  const Vector6 shares = (Vector6() << Vector3::Constant(share[0]), Vector3::Constant(share[1])).finished();
  pose.position = reference_.cartesian.position + share[0] * way.head<3>();
  pose.orientation = exp(share[1] * way.tail<3>()) * reference_.cartesian.orientation;
  pose.velocity = shares.cwiseProduct(pose.velocity);
  pose.acceleration = shares.cwiseProduct(pose.acceleration);
  return true;
}

void Loop::compute_torque() noexcept {
  if (robot_->takes_torque()) {
    Vector7 tau;
    // An arm that its controller does not bring to rest in time is damped.
    const bool lets_go = faulty_ || (skill_ == nullptr && (!holder_->controller->tracks() || (leaving_ && overdue())));
    if (!lets_go) {
      step_controller(tau);
      if (fade_time_ < left_over_.duration()) {
        fade_time_ += cycle_.dt;
        tau += left_over_.at(fade_time_).x;
      }
      if (!tau.allFinite()) watch_.not_finite(PartWatch::kController, holder_->numbers.controller);
      faulty_ = watch_.at_fault(PartWatch::kController);
      if (faulty_ && skill_ != nullptr) stop_running(Ending::kComponentFault);
    }
    if (!leaving_ || !(releases_ || overdue())) caught_ = cycle_.q;
    if (faulty_ || lets_go) {
      tau = model_.coriolis() + held_ + kFaultStiffness.cwiseProduct(caught_ - cycle_.q) - kFaultDamping.cwiseProduct(cycle_.dq);
    }
    const bool led = !lets_go && !faulty_ && holder_->controller->leads();
    held_by_ |= torque_gate_.pass(cycle_, gate_.walls(), tau, led ? away() : 0, tau_J_d_, lets_go || faulty_);
  }
  if (skill_ == nullptr) return;
  skill_held_by_ |= held_by_;
  if (held_by_ != HeldBy::kNothing) ++limited_cycles_;
}

void Loop::take_walls() noexcept {
  if (door_.walls.empty() || door_.former_walls.room() == 0) return;
  if (Walls* const former = gate_.keep_from(door_.walls.take())) door_.former_walls.push(former);
}

void Loop::take_bounds() noexcept {
  if (door_.bounds.empty() || door_.taken_bounds.room() == 0) return;
  Bounds* const bounds = door_.bounds.take();
  gate_.keep_to(*bounds);
  torque_gate_.keep_to(*bounds);
  door_.taken_bounds.push(bounds);
}

void Loop::send_command() noexcept {
  commanded_skill_ = skill_ != nullptr ? skill_->id : next_ != nullptr ? next_->id : 0;
  sent_ = (in_motion() && !stop_sent_) || phase_ == Phase::kFinishing;
  if (!sent_) return;
  command_.message_id = state_.message_id;
  if (phase_ == Phase::kFinishing) {
    command_.motion_generation_finished = true;
    command_.torque_command_finished = wire_mode_ == robot::kTorque;
  } else {
    robot_->write(gate_.before(), reference_, tau_J_d_, command_);
  }
  compute_ns_ = now_ns() - driver_.received_ns();
  driver_.send(command_);
  if (skill_ != nullptr && first_command_ns_ == 0 && !waits_for_start()) first_command_ns_ = now_ns();
}

// The first that ends the skill, of those that look for a contact or of the others; -1: none.
int Loop::ask_terminations(bool of_contact) noexcept {
  const double planned = trajectory_began_ + path_.lasts(duration(*skill_)) + slowed_;
  const Progress progress{*skill_->trajectory, trajectory_over_, reference_, waited_, planned, trajectory_began_, observer_.tau_ext(),
                          observer_.O_F_ext_K()};
  int termination = -1;
  for (std::size_t i = 0; i < skill_->terminations.size(); ++i) {
    if ((skill_->terminations[i]->then() != nullptr) != of_contact) continue;
    const auto& numbers = skill_->numbers.terminations;
    const bool ends = watch_.step(PartWatch::kTerminations + static_cast<int>(i), i < numbers.size() ? numbers[i] : 0,
                                  [&] { return skill_->terminations[i]->step(cycle_, progress); });
    if (ends && termination < 0) termination = static_cast<int>(i);
  }
  return termination;
}

// A skill ends when its reference rests.
void Loop::terminate_skill() noexcept {
  if (phase_ == Phase::kRunning && !waits_for_start()) {
    const int termination = ask_terminations(false);
    const auto& all = skill_->terminations;
    const bool may = std::all_of(all.begin(), all.end(), [](const auto& each) { return each->seeks_goal(); });
    const bool over = (all.empty() && trajectory_over_ && gate_.at_rest()) || (may && gate_.stuck() && has_end(*skill_));
    if (watch_.at_fault()) {
      stop_running(Ending::kComponentFault);
    } else if (over || termination >= 0) {
      stop_running(Ending::kTerminated, termination);
    }
  }
  if (phase_ == Phase::kBraking && skill_ != nullptr && gate_.at_rest() && !back_off_.active()) {
    end(skill_, ending_);
    hold();
  }
}

void Loop::publish() noexcept {
  Record& record = door_.records.back();
  record.state = state_;
  record.command = command_;
  if (!sent_) record.command.message_id = 0;
  record.phase = phase_;
  record.skill_id = commanded_skill_;
  record.skill_time = sent_ && commanded_skill_ != 0 ? skill_time_ : 0;
  record.reference = reference_;
  record.held_by = sent_ ? held_by_ : HeldBy::kNothing;
  record.tau_ext = observer_.tau_ext();
  record.O_F_ext_K = observer_.O_F_ext_K();
  record.collision = observer_.collision();
  record.cycles = cycles_;
  record.lost_states = lost_states_;
  record.received_ns = driver_.received_ns();
  record.compute_ns = sent_ ? compute_ns_ : 0;
  door_.records.push();
}

// --- skills --------------------------------------------------------------------------------------------------------

void Loop::post_result(SkillResult result, const Skill& skill) noexcept {
  result.skill_id = skill.id;
  result.robot_mode = state_.robot_mode;
  if (result.ending != Ending::kConnectionLost) result.record = door_.records.written();  // publish() is still to come
  if (result.ending == Ending::kRobotError) {
    // The robot keeps the reason of its last reflex: of a user stop it says nothing.
    const bool stopped = state_.robot_mode == fci::RobotMode::kUserStopped;
    result.errors = fci::any(state_.errors) || stopped ? state_.errors : state_.reflex_reason;
    if (motion_answer_) result.status = *motion_answer_;
  }
  door_.results.push(result);  // change_skill() has kept room
}

// The running skill is over; its controller keeps the arm until end_motion() or take_over().
void Loop::end(Skill* skill, Ending ending) noexcept {
  SkillResult result;
  result.ending = ending;
  result.termination = ending == Ending::kTerminated ? termination_ : -1;
  result.time = std::max(skill_time_, 0.0);
  result.path_time = std::max(path_.time(), 0.0);
  result.lost_states = skill_lost_states_;
  result.lost_commands = static_cast<std::uint64_t>(std::lround(kRateOver * std::clamp(1 - success_rate_, 0., 1.)));
  result.stretch = skill->trajectory->stretch();
  if (const double planned = duration(*skill); planned > 0 && std::isfinite(planned)) {
    result.stretch *= 1 + slowed_ / path_.lasts(planned);
  }
  result.limited_cycles = limited_cycles_;
  result.after_contact = after_contact_;
  if (after_contact_ == AfterContact::kBackedOff) result.backed_off = (cycle_.O_T_EE.translation() - touched_at_).norm();
  back_off_.stop();
  result.left = left(*skill);
  result.held_by = skill_held_by_;
  if (has(skill_held_by_, HeldBy::kWall)) result.wall = gate_.walls().wall();
  result.first_command_ns = first_command_ns_;
  result.last_cycle_ns = now_ns();
  if (ending == Ending::kComponentFault) result.fault = watch_.fault();
  if (ending == Ending::kRobotError) result.fault = watch_.longest();
  post_result(result, *skill);
  skill_ = nullptr;
  if (ending != Ending::kTerminated) unfinished_ = skill->id;
}

// s, of its trajectory's own.
double Loop::duration(const Skill& skill) const noexcept {
  return watch_.ask(skill.numbers.trajectory, [&] { return skill.trajectory->duration(); });
}

bool Loop::has_end(const Skill& skill) const noexcept {
  return watch_.ask(skill.numbers.trajectory, [&] { return skill.trajectory->has_end(); });
}

std::optional<Vector7> Loop::posture() const noexcept {
  return watch_.ask(skill_->numbers.controller, [&] { return skill_->controller->posture(); });
}

// Of a skill that has come to rest.
Left Loop::left(const Skill& skill) const noexcept {
  const double planned = duration(skill);
  if (!(planned > 0 && std::isfinite(planned)) || !gate_.at_rest()) return {};
  if (robot_->takes_torque() && !skill.controller->leads()) return {};
  const Reference& goal = watch_.ask(skill.numbers.trajectory, [&]() -> const Reference& { return skill.trajectory->goal(); });
  if (goal.motion == Channels::kJoint) return {.joints = (goal.joint.q - cycle_.q).cwiseAbs().maxCoeff()};
  const Vector6 way = change_between(at(cycle_.O_T_EE), goal.cartesian);
  return {.position = way.head<3>().norm(), .angle = way.tail<3>().norm()};
}

// The waiting skill is over before it has begun.
void Loop::drop_next(Ending ending, fci::Command refused, fci::Status status) noexcept {
  if (next_ == nullptr) return;
  SkillResult result;
  result.ending = follows_failure(*next_) ? Ending::kCancelled : ending;
  result.refused = refused;
  result.status = status;
  post_result(result, *next_);
  unfinished_ = next_->id;
  released_ = false;
  door_.retired.push(next_);
  next_ = nullptr;
}

// From now on the running skill is braked.
void Loop::stop_running(Ending ending, int termination) noexcept {
  if (phase_ == Phase::kBraking && ending != Ending::kComponentFault) return;
  phase_ = Phase::kBraking;
  ending_ = ending;
  termination_ = termination;
}

void Loop::lose_connection() noexcept {
  if (skill_ != nullptr) end(skill_, Ending::kConnectionLost);
  drop_next(Ending::kConnectionLost);
  for (auto* slot : {&door_.next, &door_.queued}) {
    next_ = slot->take();
    drop_next(Ending::kConnectionLost);
  }
  if (phase_ == Phase::kRecovering) answer_recovery(false, fci::Status::kFailed);
  end_motion(Phase::kConnecting);
}

bool Loop::fits_motion(const Skill& skill) const noexcept {
  return skill.mode == mode_ && settings_.in_force(skill.settings) && !faulty_;
}

bool Loop::follows_failure(const Skill& skill) const noexcept { return skill.after != 0 && skill.after == unfinished_; }

// For the end of the running skill.
bool Loop::next_waits() const noexcept {
  if (next_->start_ns > driver_.received_ns()) return true;
  if (next_->after == 0 || skill_ == nullptr) return false;
  const bool blends = next_->blend > 0 && phase_ == Phase::kRunning && !waits_for_start() && fits_motion(*next_) &&
                      has_end(*skill_) && path_.lasts(duration(*skill_) - path_.time()) <= next_->blend;
  return !blends;
}

// That there is one whose motion may be started: before its start time if its controller lets the arm rest until then, as one that
// leads it does; another would have its way with it.
bool Loop::may_begin() const noexcept {
  return next_ != nullptr && (next_->controller->leads() || next_->start_ns <= driver_.received_ns());
}

void Loop::hold() noexcept {
  phase_ = Phase::kHolding;
  leaving_ = false;
  const double time = holder_->controller->tracks() ? options_.hold_time : 0;
  hold_until_ = state_.message_id + static_cast<std::uint64_t>(time / kTick);
}

// To rest, and then to the finish flag.
void Loop::leave_motion() noexcept {
  if (!leaving_) {
    leaving_ = true;
    phase_ = Phase::kBraking;
    set_deadline(kSettlingTime);
  }
  if (stop_sent_) return;
  if (state_.message_id >= deadline_ + kDampedTime) {
    stop_sent_ = driver_.post(fci::StopMove{}).has_value();
    faulty_ |= stop_sent_;
    return;
  }
  if (!robot_->may_finish(cycle_) || !(gate_.at_rest() || faulty_)) return;
  phase_ = Phase::kFinishing;
  set_deadline(kAnswerTime);
}

// next_ becomes the running skill, from reference_ on.
void Loop::start_skill() noexcept {
  const double speed_before = holder_ != nullptr ? holder_->speed : 1;
  if (holder_ != nullptr) door_.retired.push(holder_);
  holder_ = skill_ = next_;
  next_ = nullptr;
  released_ = false;
  phase_ = Phase::kRunning;
  leaving_ = false;
  hold_until_ = std::numeric_limits<std::uint64_t>::max();
  limited_cycles_ = skill_lost_states_ = 0;
  success_rate_ = 1;
  skill_held_by_ = HeldBy::kNothing;
  first_command_ns_ = 0;
  after_contact_ = AfterContact::kNoContact;
  cycle_.time = 0;
  watch_.reset();
  begin_to_listen();
  place_joints();
  start_controller(!robot_->has_reference());
  gate_.reset(reference_);
  start_trajectory(speed_before);
  start_terminations();
}

// What its parts take in is not older than their timeouts now.
void Loop::begin_to_listen() noexcept {
  for (const auto& input : skill_->inputs) input->begin(state_.message_id);
}

// Those that the reference means.
void Loop::place_joints() noexcept {
  if (reference_.motion == Channels::kJoint) gate_.place(reference_.joint.q);
  cycle_.q_ref = gate_.joints().q;
}

// Torque stays as it was: a reference that is ours alone is moved, one of the robot's cannot be; what difference is left
// fades away.
void Loop::start_controller(bool move_reference) noexcept {
  fade_time_ = left_over_.duration();
  if (!robot_->takes_torque()) return;
  Reference unmoved = followed();
  watch_.start(PartWatch::kController, skill_->numbers.controller,
               [&] { skill_->controller->start(cycle_, move_reference ? reference_ : unmoved); });
  Vector7 tau;
  step_controller(tau);
  if (!tau.allFinite()) return;
  const Vector7 zero = Vector7::Zero();
  const Vector7 difference = cycle_.tau_J_d - tau;
  // An arm that its robot's reference is far away from is not flung there.
  const double share = torque_gate_.share(difference);
  left_over_.set_duration(std::min(kFadeTime + kFadePerTorque * std::max(share - 1, 0.), kLongestFade));
  left_over_.start(difference, zero, zero, zero, 0);
  fade_time_ = 0;
}

// The running skill goes on with other parts.
void Loop::change_parts() noexcept {
  if (change_ == nullptr) change_ = door_.change.take();
  if (change_ == nullptr || door_.changed.room() == 0) return;
  if (begins_ || change_->skill_id > newest_ || (next_ != nullptr && next_->id == change_->skill_id)) return;  // it has not begun
  Change* change = std::exchange(change_, nullptr);
  if (phase_ == Phase::kRunning && skill_->id == change->skill_id && !faulty_) {
    change->done = true;
    std::swap(skill_->inputs, change->inputs);
    begin_to_listen();
    watch_.reset();
    const bool was_led = change->controller && go_on_from_arm();
    const TrajectoryGenerator& trajectory = change->trajectory ? *change->trajectory : *skill_->trajectory;
    const bool moves_on = was_led || reference_.motion != motion_of(trajectory.fills());
    if (moves_on) {
      change_motion(motion_of(trajectory.fills()));
      place_joints();
    }
    if (change->controller) {
      std::swap(skill_->controller, change->controller);
      skill_->numbers.controller = change->numbers.controller;
    }
    if (change->controller || moves_on) start_controller(false);
    if (moves_on || change->trajectory) gate_.reset(reference_);
    if (change->trajectory) {
      std::swap(skill_->trajectory, change->trajectory);
      skill_->numbers.trajectory = change->numbers.trajectory;
    }
    if (change->trajectory || was_led) start_trajectory(skill_->speed);
    if (change->changes_terminations) {
      std::swap(skill_->terminations, change->terminations);
      std::swap(skill_->numbers.terminations, change->numbers.terminations);
      start_terminations();
    }
  }
  door_.changed.push(change);
}

// Its start time has not come; the arm rests.
bool Loop::waits_for_start() const noexcept {
  return phase_ == Phase::kRunning && first_command_ns_ == 0 && skill_->start_ns > driver_.received_ns();
}

void Loop::start_trajectory(double speed_before) noexcept {
  path_.start(skill_->speed);
  trajectory_began_ = waits_for_start() ? 0 : cycle_.time;
  trajectory_over_ = held_back_ = false;
  slowed_ = 0;
  waited_ = false;
  rejoin_.stop();
  wanted_ = {};  // a trajectory that exerts nothing does not say so
  const Reference from = skill_->start_from(reference_, speed_before);
  watch_.start(PartWatch::kTrajectory, skill_->numbers.trajectory, [&] { skill_->trajectory->start(from); });
}

void Loop::start_terminations() noexcept {
  for (std::size_t i = 0; i < skill_->terminations.size(); ++i) {
    const auto& numbers = skill_->numbers.terminations;
    skill_->terminations[i]->watched_by(watch_);
    watch_.start(PartWatch::kTerminations + static_cast<int>(i), i < numbers.size() ? numbers[i] : 0,
                 [&] { skill_->terminations[i]->start(); });
  }
}

void Loop::step_controller(Vector7& tau) noexcept {
  watch_.step(PartWatch::kController, holder_->numbers.controller,
              [&] { return holder_->controller->step(cycle_, followed(), tau), true; });
}

// What the controller follows: the reference, or the joints that the robot moves along with a pose.
const Reference& Loop::followed() noexcept {
  if (!robot_->makes_joints() || has(holder_->controller->takes(), Channels::kPose)) return reference_;
  joints_of_robot_.motion = Channels::kJoint;
  joints_of_robot_.joint = {vector(state_.q_d), vector(state_.dq_d), vector(state_.ddq_d)};
  return joints_of_robot_;
}

// From the moving reference of the skill before: this cycle's command is one tick later.
void Loop::take_over() noexcept {
  if (skill_ != nullptr) {
    termination_ = phase_ == Phase::kBraking ? termination_ : -1;
    end(skill_, phase_ == Phase::kBraking ? ending_ : next_->after != 0 ? Ending::kTerminated : Ending::kPreempted);
  }
  go_on_from_arm();
  robot_->pass(static_cast<int>(ticks_), gate_.limiter(), reference_);
  const bool strayed = robot_->has_reference() && ticks_ > 1;
  change_motion(motion_of(next_->trajectory->fills()));
  start_skill();
  if (strayed) gate_.strayed();
  ticks_ = 1;
  skill_time_ = kTick - cycle_.dt;
}

// Where the controller has let the arm go, the reference is there; returns whether it has.
bool Loop::go_on_from_arm() noexcept {
  if (holder_->controller->tracks()) return false;
  gate_.place(cycle_.q);
  reference_.motion = Channels::kJoint;
  reference_.joint = {cycle_.q, cycle_.dq, Vector7::Zero()};
  return true;
}

// Under torque control a reference of joints may be replaced by a pose, and a pose by joints: that of the same motion of the arm.
void Loop::change_motion(Channels motion) noexcept {
  if (reference_.motion == motion) return;
  reference_.motion = motion;
  if (motion == Channels::kPose) {
    model_.update(reference_.joint.q, reference_.joint.dq);
    CartesianReference& out = reference_.cartesian;
    out.position = model_.O_T_EE().translation();
    out.orientation = Eigen::Quaterniond(model_.O_T_EE().linear());
    out.velocity = model_.jacobian() * reference_.joint.dq;
    out.acceleration = model_.jacobian() * reference_.joint.ddq + model_.dJ_dq();
    model_.update(cycle_.q, cycle_.dq);
    gate_.place(reference_.joint.q);
  } else {
    const JointsOfPose& joints = gate_.joints();
    reference_.joint = {joints.q, joints.dq_dP * reference_.cartesian.velocity, Vector7::Zero()};
  }
}

// --- the robot's side ----------------------------------------------------------------------------------------------

bool Loop::robot_idle() const noexcept {
  using Generator = fci::MotionGeneratorMode;
  const Generator generator = state_.motion_generator_mode;
  return state_.robot_mode == fci::RobotMode::kIdle && state_.controller_mode != fci::ControllerMode::kExternal &&
         (generator == Generator::kIdle || generator == Generator::kNone);
}

bool Loop::robot_matches() const noexcept {
  return state_.robot_mode == fci::RobotMode::kMove && state_.controller_mode == wire_mode_.controller &&
         state_.motion_generator_mode == wire_mode_.generator;
}

// Whether commands did not come to the robot, which made up for them: then the reference goes on from where it is.
bool Loop::commands_were_lost() noexcept {
  return sent_ && robot_->reconcile(state_, driver_.version(), static_cast<int>(ticks_), gate_.limiter(), reference_);
}

bool Loop::in_motion() const noexcept {
  return phase_ == Phase::kRunning || phase_ == Phase::kHolding || phase_ == Phase::kBraking;
}

void Loop::configure() noexcept {
  if (next_ != nullptr && !released_ && would_leap()) {
    released_ = true;
    return start_motion(true);
  }
  phase_ = Phase::kConfiguring;
  set_deadline(kAnswerTime);
  settings_.ask(next_ != nullptr ? next_->settings : robot::Settings{});
}

// `release`: one that only lets the arm go where it is.
void Loop::start_motion(bool release) noexcept {
  phase_ = Phase::kStarting;
  set_deadline(kAnswerTime);
  releases_ = release;
  mode_ = release ? robot::kTorque : next_->mode;
  robot_ = &robot_controller(mode_);
  wire_mode_ = robot::on_wire(mode_, driver_.version());
  move_id_.reset();
  move_again_ = 0;
  motion_answer_.reset();
}

// The robot's modes match: the first command is due in this cycle.
void Loop::begin_motion() noexcept {
  tau_J_d_.setZero();
  cycle_.tau_J_d.setZero();
  faulty_ = stop_sent_ = false;
  held_.setZero();
  ticks_ = 1;
  cycle_.dt = kTick;  // whatever was lost before it
  cycle_.dq_ref.setZero();  // it may be that of a motion which has failed
  gate_.place(cycle_.q);
  gate_.walls().begin();
  if (releases_) return let_go();
  begins_for_ = robot_->has_reference() ? RobotController::kMostLost : 0;
  begins_at_ = vector(state_.q_d);
  reference_ = robot_->start(cycle_, motion_of(next_->trajectory->fills()), model_);
  start_skill();
  begin_time();
}

// The time of a skill begins with this cycle's command.
void Loop::begin_time() noexcept {
  skill_time_ = -cycle_.dt;
  path_.step_back();
}

// As the first command did not come. Else the second was the first that the robot gets: it may begin the motion there, at rest.
void Loop::begin_again() noexcept {
  begins_ = false;
  if (begins_for_ == 0) return;
  const bool begun = state_.control_command_success_rate > 0 || vector(state_.q_d) != begins_at_;
  if (begun || phase_ != Phase::kRunning) {
    begins_for_ = 0;
    return;
  }
  const int left = begins_for_ - 1;
  Skill* const waits = next_;
  next_ = std::exchange(skill_, nullptr);
  holder_ = nullptr;
  for (const auto& input : next_->inputs) input->begin_again();
  begin_motion();  // with the command before, of which there is need where the motion is left in this cycle
  next_ = waits;
  begins_for_ = left;
  begins_ = true;
}

// Whether the robot's own law, as it is to be for the next skill, would tear the arm from where a softer one lets it be: it holds
// q_d, where the motion begins.
bool Loop::would_leap() const noexcept {
  const auto& of_joints = settings_.to_be(&robot::Settings::joint_impedance, next_->settings);
  const auto& of_pose = settings_.to_be(&robot::Settings::cartesian_impedance, next_->settings);
  Vector7 pull = vector(state_.q_d) - cycle_.q;
  if (next_->mode.controller == fci::ControllerMode::kJointImpedance && of_joints) {
    pull = vector(of_joints->K_theta).cwiseProduct(pull);
  } else if (next_->mode.controller == fci::ControllerMode::kCartesianImpedance && of_pose) {
    const Vector6 K = Vector6::Map(of_pose->K_x.data());
    Vector6 wrench = model_.jacobian() * pull;
    wrench << K.head<3>().maxCoeff() * wrench.head<3>(), K.tail<3>().maxCoeff() * wrench.tail<3>();
    pull = model_.jacobian().transpose() * wrench;
  } else {
    return false;
  }
  const Vector7 felt = vector(state_.tau_ext_hat_filtered);  // what it is held by now
  const auto leaps = [&](const Vector7& tau) { return torque_gate_.share(tau) > kLeap; };
  return leaps(pull) && (!felt.allFinite() || leaps(pull - felt));
}

// A motion of torques alone, which hold the arm where it is and damp it; when it is finished the robot holds the arm there.
void Loop::let_go() noexcept {
  reference_ = robot_->start(cycle_, Channels::kJoint, model_);
  gate_.reset(reference_);
  if (const Vector7 felt = vector(state_.tau_ext_hat_filtered); felt.allFinite()) held_ = felt;
  skill_time_ = 0;
  caught_ = cycle_.q;
  faulty_ = leaving_ = true;  // no controller is asked
  phase_ = Phase::kBraking;
  set_deadline(kSettlingTime);
}

void Loop::end_motion(Phase phase) noexcept {
  phase_ = phase;
  if (holder_ != nullptr) door_.retired.push(holder_);
  holder_ = nullptr;
  move_id_.reset();
  tau_J_d_.setZero();
}

// The robot has left the motion, or does not take one.
void Loop::fail_motion() noexcept {
  if (skill_ != nullptr) end(skill_, Ending::kRobotError);
  drop_next(Ending::kRobotError);
  end_motion(robot_idle() ? Phase::kIdle : Phase::kError);
  if (phase_ == Phase::kError) error_began_ = cycles_;
  motion_answer_.reset();
}

void Loop::recover(std::uint64_t seen) noexcept {
  if (phase_ == Phase::kRecovering) return;  // one at a time; the flag waits
  if (robot_idle()) user_stopped_ = false;   // it was released
  if (phase_ == Phase::kError && robot_idle()) phase_ = Phase::kIdle;
  if (phase_ != Phase::kError) {
    answer_recovery(true, fci::Status::kSuccess);
    return;
  }
  if (seen < error_began_) {
    recovery_accepted_ = false;
    answer_recovery(false, fci::Status::kSuccess, true);
    return;
  }
  recovery_id_ = driver_.post(fci::AutomaticErrorRecovery{});
  if (!recovery_id_) return;  // the connection takes nothing now: next cycle again
  door_.recover = 0;
  recovery_accepted_ = false;
  phase_ = Phase::kRecovering;
  set_deadline(kRecoveryTime);
}

void Loop::answer_recovery(bool recovered, fci::Status status, bool unseen) noexcept {
  door_.recover = 0;  // whoever has asked meanwhile is told this too
  if (phase_ == Phase::kRecovering) phase_ = recovered ? Phase::kIdle : Phase::kError;
  recovery_id_.reset();
  const auto record = lost_ ? std::nullopt : std::optional(door_.records.written());  // publish() is still to come
  door_.recoveries.push({recovered, recovery_accepted_, unseen, status, state_.robot_mode, record});
}

void Loop::update_tool() noexcept {
  const fci::RobotState& s = state_;
  fci::RobotState& t = tool_state_;
  if (s.F_T_EE == t.F_T_EE && s.m_ee == t.m_ee && s.F_x_Cee == t.F_x_Cee && s.I_ee == t.I_ee &&
      s.m_load == t.m_load && s.F_x_Cload == t.F_x_Cload && s.I_load == t.I_load) {
    return;
  }
  t = s;
  carry(s, model_);
  observer_.reset();
}

}  // namespace realtime
