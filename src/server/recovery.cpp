#include "server/recovery.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "realtime/joint_range.hpp"
#include "server/clocks.hpp"
#include "server/convert.hpp"
#include "server/refused.hpp"

namespace server {
namespace {

using realtime::Vector7;
using Policy = proto::RecoveryPolicy;
using Outside = Recovery::Outside;

constexpr double kInside = 0.005;  // rad from the end of a joint's range, where one that was outside is moved to

constexpr fci::Error kCollisions[] = {fci::Error::kSelfCollisionAvoidance, fci::Error::kJointReflex, fci::Error::kCartesianReflex};

// Where people have to do something first.
proto::Obstacle hand_on(fci::RobotMode mode) {
  switch (mode) {
    case fci::RobotMode::kGuiding: return proto::HELD_BY_HAND;
    case fci::RobotMode::kUserStopped: return proto::STOPPED_BY_USER;
    case fci::RobotMode::kOther: return proto::NOT_ACTIVE;
    default: return proto::NO_OBSTACLE;
  }
}

const char* advice(proto::Obstacle obstacle) {
  switch (obstacle) {
    case proto::HELD_BY_HAND: return "let go of the guiding buttons and release the user stop";
    case proto::STOPPED_BY_USER: return "release the user stop and look at the arm";
    case proto::NOT_ACTIVE: return "unlock the joints and activate FCI in Desk";
    default: return "look at the arm and clear what caused it";
  }
}

// The joints that are outside their range, 1 to 7, by how much; rad.
Outside outside(const Vector7& q, const models::Limits& limits) {
  Outside joints;
  for (int i = 0; i < models::kJoints; ++i) {
    const double excess = std::max(limits.q_min[i] - q[i], q[i] - limits.q_max[i]);
    if (excess > 0) joints.emplace_back(i + 1, excess);
  }
  return joints;
}

std::string text(const Outside& joints) {
  std::string text;
  for (const auto& [joint, excess] : joints) {
    text += fmt::format("{}joint {} is {:.4f} rad outside its range", text.empty() ? "" : ", ", joint, excess);
  }
  return text;
}

Vector7 joints_of(const realtime::Record& record) { return Vector7::Map(record.state.q.data()); }

}  // namespace

Recovery::Recovery(realtime::Door& door, const ConnectedArm& arm, const RecoveryConfig& lab, MoveBack move_back)
    : door_(door), arm_(arm), lab_(lab), move_back_(std::move(move_back)) {}

void Recovery::after_error(const realtime::SkillResult& result, const realtime::Record& record, const proto::RecoveryPolicy& policy,
                           Answer answer) {
  // With the skill that ran one may end that had not begun, and has no say.
  const bool same = result.record && result.record == failed_in_;
  failed_in_ = result.record;
  if (!same) failed_under_ = policy;
  // The robot may have ended the motion, and take another.
  if (record.phase != realtime::Phase::kError && record.phase != realtime::Phase::kConnecting) {
    proto::Recovery out;
    out.set_recovered(true);
    out.set_time(0);
    return answer(out);
  }
  const Who who = who_may(cause_of(record), failed_under_);
  if (who != Policy::ITSELF || hand_on(record.state.robot_mode) != proto::NO_OBSTACLE) return answer(not_recovered(record, who));
  start(std::move(answer), true, record, result.last_cycle_ns != 0 ? result.last_cycle_ns : now_ns());
}

void Recovery::after(realtime::Ending ending) {
  if (ending == realtime::Ending::kCancelled) return;  // it has not begun
  failed_under_.Clear();
  if (ending == realtime::Ending::kTerminated) in_a_row_ = 0;
}

void Recovery::ask(const proto::Recover& recover, bool stopped, const realtime::Record& now, Answer answer) {
  const bool by_itself = recover.has_under();
  if (!until_back_.empty()) return until_back_.push_back({std::move(answer), by_itself, now_ns()});
  if (now.phase == realtime::Phase::kError) {
    const Cause cause = cause_of(now);
    const Who who = by_itself ? std::min(who_may(cause), who_may(cause, recover.under())) : who_may(cause);
    const bool may = by_itself ? who == Policy::ITSELF : who != Policy::NEVER;
    if (!may || hand_on(now.state.robot_mode) != proto::NO_OBSTACLE) return answer(not_recovered(now, who));
  }
  start(std::move(answer), by_itself, now, now_ns());
  stopped_ |= stopped;
}

void Recovery::stop() {
  if (!waiting_.empty()) stopped_ = true;
}

void Recovery::start(Answer answer, bool by_itself, const realtime::Record& seen, std::int64_t begin_ns) {
  if (waiting_.empty()) stopped_ = false;
  waiting_.push_back({std::move(answer), by_itself, begin_ns});
  door_.recover.store(std::max({door_.recover.load(), seen.cycles, std::uint64_t{1}}));
}

void Recovery::take_results() {
  while (const realtime::RecoveryResult* front = door_.recoveries.front()) {
    // Whoever is told reads a state that knows of it.
    if (front->record && *front->record >= door_.records.written()) return;
    const auto limits = this->limits();
    if (!limits) return;  // abandon() comes
    const realtime::RecoveryResult result = *front;
    door_.recoveries.pop();
    auto waiting = std::exchange(waiting_, {});
    if (waiting.empty()) continue;
    realtime::Record record;
    const bool known = result.record && door_.records.read(*result.record, record);
    if (!known) record.state.robot_mode = result.robot_mode;
    const Outside joints = known ? outside(joints_of(record), *limits) : Outside();
    if (!result.recovered) {
      finish(std::move(waiting), failed(result, record, joints));
      continue;
    }
    proto::Recovery out;
    out.set_recovered(true);
    const bool at_rest = record.phase == realtime::Phase::kIdle || record.phase == realtime::Phase::kConfiguring;
    if (!at_rest || joints.empty()) {
      finish(std::move(waiting), out);
      continue;
    }
    if (stopped_) {
      proto::Recovery left;
      left.set_obstacle(proto::OUTSIDE_JOINT_LIMITS);
      left.set_message(text(joints) + ", and was not moved back, as stop was asked for: recover again");
      finish(std::move(waiting), left);
      continue;
    }
    for (const auto& [joint, excess] : joints) out.add_moved_back(static_cast<std::uint32_t>(joint));
    spdlog::info("{}: the arm is moved back slowly", text(joints));
    Vector7 q = joints_of(record);
    for (const auto& [joint, excess] : joints) {
      const int i = joint - 1;
      q[i] = std::clamp(q[i], realtime::rest_min(*limits, i) + kInside, realtime::rest_max(*limits, i) - kInside);
    }
    until_back_ = std::move(waiting);
    move_back_(q, [this, out, what = text(joints)](const std::string& why_not) mutable {
      if (!why_not.empty()) {
        out.Clear();
        out.set_obstacle(proto::OUTSIDE_JOINT_LIMITS);
        out.set_message(fmt::format("{}, and was not moved back: {}", what, why_not));
      }
      finish(std::exchange(until_back_, {}), out);
    });
  }
}

void Recovery::abandon(const std::string& why) {
  door_.recover.store(0);
  while (door_.recoveries.front() != nullptr) door_.recoveries.pop();
  proto::Recovery out;
  out.set_obstacle(proto::NOT_CONNECTED);
  out.set_message(why);
  finish(std::exchange(waiting_, {}), out);
}

void Recovery::finish(std::vector<Waiting> waiting, proto::Recovery out) {
  if (out.recovered()) {
    const bool by_itself = std::all_of(waiting.begin(), waiting.end(), [](const Waiting& each) { return each.by_itself; });
    in_a_row_ = by_itself ? in_a_row_ + 1 : 0;
    if (by_itself) spdlog::warn("the arm has recovered by itself, {} times in a row", in_a_row_);
  }
  for (const Waiting& each : waiting) {
    out.set_by_itself(each.by_itself && out.recovered());
    out.set_in_a_row(in_a_row_);
    out.set_time(static_cast<double>(now_ns() - each.begin_ns) * 1e-9);
    each.answer(out);
  }
}

std::optional<models::Limits> Recovery::limits() const {
  try {
    return arm_.require().limits;
  } catch (const Refused&) {
    return std::nullopt;
  }
}

Recovery::Cause Recovery::cause_of(const realtime::Record& record) {
  const fci::RobotState& state = record.state;
  const fci::RobotMode mode = state.robot_mode;
  // An idle robot in kError was let go by its user stop.
  const bool stopped = mode == fci::RobotMode::kUserStopped || mode == fci::RobotMode::kGuiding || mode == fci::RobotMode::kIdle;
  if (stopped) return Cause::kUserStop;
  const fci::Errors& errors = fci::any(state.errors) ? state.errors : state.reflex_reason;
  if (mode == fci::RobotMode::kReflex && !fci::any(errors)) return Cause::kCollision;  // as nobody knows better
  const bool collision = std::any_of(std::begin(kCollisions), std::end(kCollisions),
                                     [&](fci::Error error) { return errors[static_cast<std::size_t>(error)]; });
  return collision ? Cause::kCollision : Cause::kError;
}

Recovery::Who Recovery::lab(Cause cause) const {
  switch (cause) {
    case Cause::kCollision: return lab_.collisions;
    case Cause::kUserStop: return lab_.user_stop;
    case Cause::kError: break;
  }
  return lab_.errors;
}

bool Recovery::too_often(unsigned times) const { return in_a_row_ >= std::min(times, lab_.times); }

Recovery::Who Recovery::who_may(Cause cause, const proto::RecoveryPolicy& policy) const {
  const Who who = std::min(lab(cause), policy.who());
  return who == Policy::ITSELF && too_often(policy.times()) ? Policy::ASK : who;
}

// Whoever asks.
Recovery::Who Recovery::who_may(Cause cause) const {
  return failed_under_.who() == Policy::NEVER && cause != Cause::kUserStop ? Policy::NEVER : lab(cause);  // who has pressed the stop was at the robot
}

proto::Recovery Recovery::not_recovered(const realtime::Record& record, Who who) const {
  proto::Recovery out;
  out.set_recovered(false);
  out.set_who(who);
  out.set_in_a_row(in_a_row_);
  const Cause cause = cause_of(record);
  const proto::Obstacle hand = hand_on(record.state.robot_mode);
  out.set_obstacle(hand != proto::NO_OBSTACLE ? hand : cause == Cause::kUserStop ? proto::STOPPED_BY_USER : proto::IN_REFLEX);
  const char* key = cause == Cause::kCollision ? "collisions" : "errors";
  if (who == Policy::NEVER) {
    out.set_message(fmt::format("look at the arm and clear it in Desk, or by the user stop: {} leaves it to people at the robot",
                                lab(cause) == Policy::NEVER ? fmt::format("the lab's file (arm.recovery.{})", key) : "the skill"));
  } else {
    const std::string often = in_a_row_ > 1 ? fmt::format(" (it has recovered {} times in a row by itself)", in_a_row_) : "";
    out.set_message(fmt::format("{}, then recover{}", advice(hand), often));
  }
  return out;
}

// The robot did not do it.
proto::Recovery Recovery::failed(const realtime::RecoveryResult& result, const realtime::Record& record,
                                 const Outside& outside) const {
  const Who who = record.phase == realtime::Phase::kError ? who_may(cause_of(record)) : Policy::ASK;
  if (result.unseen || hand_on(result.robot_mode) != proto::NO_OBSTACLE) return not_recovered(record, who);
  proto::Recovery out;
  out.set_recovered(false);
  out.set_who(who);
  out.set_obstacle(proto::IN_REFLEX);
  const bool manual = result.status == fci::Status::kManualErrorRecoveryRequired;
  if (manual && !outside.empty()) {
    out.set_obstacle(proto::OUTSIDE_JOINT_LIMITS);
    out.set_message(text(outside) + ", where the robot lets only a hand move it: press the user stop, guide the arm back, release, "
                                   "then recover");
  } else if (result.accepted) {
    out.set_message("the robot took AutomaticErrorRecovery but is not ready to move: what has stopped it may be there still. Look "
                    "whether the arm presses against something");
  } else if (result.status == fci::Status::kFailed) {
    out.set_message("the robot gave no answer to AutomaticErrorRecovery in time: try again");
  } else {
    out.set_message(fmt::format("the robot refused AutomaticErrorRecovery: {}. Look at its lights and its Desk page",
                                fci::name(result.status)));
  }
  return out;
}

}  // namespace server
