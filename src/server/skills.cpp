#include "server/skills.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "server/convert.hpp"
#include "server/publisher.hpp"
#include "server/recorder.hpp"
#include "server/recovery.hpp"
#include "server/refused.hpp"
#include "server/registry.hpp"
#include "server/sensor_hub.hpp"

namespace server {
namespace {

constexpr std::size_t kMaxResults = 256;  // remembered
constexpr std::size_t kMaxQueue = 256;

SensorHub::Inputs inputs_of(const std::vector<std::unique_ptr<realtime::Termination>>& terminations) {
  SensorHub::Inputs all;
  for (const auto& termination : terminations) {
    for (auto& input : termination->sensor_inputs()) all.push_back(std::move(input));
  }
  return all;
}

// What a person should know of an arm that has ended its motion elsewhere; empty where that is near.
std::string explain(const realtime::Left& left) {
  constexpr double kFarJoint = 0.05, kFar = 0.02, kFarAngle = 0.1;  // rad, m, rad: more than friction and a load leave
  std::string how;
  if (left.joints.value_or(0) > kFarJoint) how = fmt::format("{:.2f} rad", *left.joints);
  if (left.position.value_or(0) > kFar || left.angle.value_or(0) > kFarAngle) {
    how = fmt::format("{:.0f} mm and {:.2f} rad", 1e3 * *left.position, *left.angle);
  }
  if (how.empty()) return {};
  return "the arm came to rest " + how +
         " away from its goal: does something hold it, do limits keep it from there, or are its gains too low?";
}

// Why what was before a skill's end is to be kept; empty where nobody will ask.
std::string worth_keeping(const realtime::SkillResult& result, const realtime::Record& record) {
  switch (result.ending) {
    case realtime::Ending::kRobotError: return fci::any(result.errors) ? fci::names(result.errors) : errors_of(record.state);
    case realtime::Ending::kConnectionLost: return "connection-lost";
    case realtime::Ending::kComponentFault: return "component-fault";
    default: return {};
  }
}

}  // namespace

SensorHub::Inputs Skills::Listening::all() const {
  SensorHub::Inputs all;
  for (const auto& each : {trajectory, controller, terminations}) {
    if (each) all.insert(all.end(), each->begin(), each->end());
  }
  return all;
}

Skills::Listening Skills::listening_of(const realtime::Skill& skill) {
  return {skill.trajectory->sensor_inputs(), skill.controller->sensor_inputs(), inputs_of(skill.terminations)};
}

Skills::Skills(realtime::Door& door, Publisher& publisher, SensorHub& sensors, Recorder& recorder, ConnectedArm& arm,
               Clients& clients, Answers& answers, ClientJobs& jobs, Recovery& recovery)
    : door_(door),
      publisher_(publisher),
      sensors_(sensors),
      recorder_(recorder),
      arm_(arm),
      clients_(clients),
      answers_(answers),
      jobs_(jobs),
      recovery_(recovery) {}

Skills::~Skills() { take_results(); }

void Skills::start(const Address& from, proto::Request& request, std::uint64_t id) {
  auto build = std::make_shared<Build>();
  const Found found = find(from, request.start_skill());
  build->from = from;
  build->connection = arm_.require();
  build->message.Swap(request.mutable_start_skill()->mutable_skill());
  build->skill_id = id;
  if (found.queued) build->before.end = running_.at(request.start_skill().after()).goal;
  put_what_runs(build->before);
  build->request = std::move(request);
  put_on_workbench(std::move(build), &Skills::begin);
}

void Skills::put_what_runs(Before& before) const {
  const auto now = running_.find(require_state().skill_id);
  if (now == running_.end()) return;
  before.speed = now->second.message.speed();
  before.lets_go = now->second.lets_go;
}

// Throws Refused where a skill of this client cannot be started now.
Skills::Found Skills::find(const Address& from, const proto::StartSkill& start) const {
  clients_.require_lease(from);
  const realtime::Record now = require_state();
  if (now.phase == realtime::Phase::kError) {
    throw Refused(proto::Error::NOT_READY,
                  fmt::format("the robot takes no motion: {}. Clear what caused it, then recover", errors_of(now.state)));
  }
  if (now.phase == realtime::Phase::kRecovering) {
    throw Refused(proto::Error::NOT_READY, "the robot is recovering from an error: wait until that is done");
  }
  const std::uint64_t last = !running_.empty() && running_.rbegin()->second.starter.client == from.client
                                 ? running_.rbegin()->first
                                 : 0;  // of this client's skills
  const std::uint64_t after = start.after();
  const auto ended = results_.find(after);
  if (after != 0 && start.preempt()) {
    refuse("StartSkill has preempt and after: expected one of the two");
  }
  if (after != 0 && after != last && ended == results_.end()) {
    refuse(fmt::format("StartSkill.after = {}: expected the last skill of this client{}", after,
                       last != 0 ? fmt::format(", {}", last) : ""));
  }
  if (last != 0 && after != last && !start.preempt()) {
    throw Refused(proto::Error::BUSY, fmt::format("skill {} of this client still runs: wait for it, stop it, preempt it or "
                                                  "queue behind it",
                                                  last));
  }
  const bool queued = after != 0 && after == last;
  if (queued && queue_.size() >= kMaxQueue) {
    throw Refused(proto::Error::BUSY, fmt::format("{} skills are queued already: wait for one to end", queue_.size()));
  }
  return {queued, !queued && after != 0 && ended->second.ending() != proto::TERMINATED};
}

// One that is built. Meanwhile another client may have taken the lease, or the skill before it may have ended.
void Skills::begin(Build& build) {
  const Address& from = build.from;
  const proto::StartSkill& start = build.request.start_skill();
  const Found found = find(from, start);
  auto skill = std::move(build.skill);
  const Listening listening = listening_of(*skill);
  const auto publishers = build.message.publishers();
  sensors_.check(publishers, listening.all());
  clients_.take_lease(from);
  const std::uint64_t id = skill->id = build.skill_id;
  if (found.queued) skill->after = start.after();
  skill->blend = start.blend();
  skill->inputs = listening.all();
  publisher_.describe(id, build.message);
  proto::SkillEvent event;
  event.mutable_started()->Swap(&build.message);
  note(event, id, from);
  const realtime::Reference goal = skill->trajectory->goal();
  Running running{from, goal, std::move(*event.mutable_started()), skill->mode, skill->settings,
                  !skill->controller->tracks(), build.made_at, listening, found.queued};
  if (!found.queued) cancel_queue(realtime::Ending::kPreempted);
  running_.emplace(id, std::move(running));
  sensors_.bind(id, listening.all(), found.queued, from.who.name, publishers);
  std::unique_ptr<realtime::Skill> unread;
  if (found.queued) {
    queue_.push_back(std::move(skill));
    hand_on_queued();
  } else if (!found.cancelled) {
    unread = door_.next.put(std::move(skill));
  }
  proto::Reply reply;
  auto& started = *reply.mutable_skill_started();
  started.set_skill_id(id);
  convert(goal, started);
  answers_.send(from, reply);
  if (found.cancelled) end({.skill_id = id, .ending = realtime::Ending::kCancelled});
  if (unread) end({.skill_id = unread->id, .ending = realtime::Ending::kPreempted});
}

// What the running skill is with other parts, of which only these are handed to the loop.
void Skills::change(const Address& from, proto::Request& request) {
  auto build = std::make_shared<Build>();
  build->from = from;
  build->message = changed(from, request.change_skill());
  build->connection = arm_.require();
  const Running& running = running_.at(request.change_skill().skill_id());
  build->before.speed = running.message.speed();
  build->before.lets_go = running.lets_go && request.change_skill().has_controller();
  if (!request.change_skill().has_trajectory()) build->made_at.trajectory = running.made_at.trajectory;
  if (!request.change_skill().has_controller()) build->made_at.controller = running.made_at.controller;
  build->request = std::move(request);
  put_on_workbench(std::move(build), &Skills::begin_change);
}

// What the skill is then. Throws Refused where it cannot be changed now.
proto::Skill Skills::changed(const Address& from, const proto::ChangeSkill& change) const {
  clients_.require_lease(from);
  const realtime::Record now = require_state();
  const auto running = running_.find(change.skill_id());
  if (running == running_.end() || running->second.starter.client != from.client) {
    refuse(fmt::format("ChangeSkill.skill_id = {}: no skill of this client that runs", change.skill_id()));
  }
  if (running->second.queued && now.skill_id < change.skill_id()) {
    throw Refused(proto::Error::NOT_READY,
                  fmt::format("skill {} waits behind another: it can be changed once it runs", change.skill_id()));
  }
  if (!change.has_trajectory() && !change.has_controller() && change.terminations().empty()) {
    refuse("ChangeSkill changes nothing: expected trajectory, controller or terminations");
  }
  if (changing_) throw Refused(proto::Error::BUSY, "another change of this skill is on its way: wait for its answer");
  proto::Skill message = running->second.message;
  message.clear_start_time();
  message.set_robot_controller(name_of(running->second.mode));
  if (change.has_trajectory()) *message.mutable_trajectory() = change.trajectory();
  if (change.has_controller()) *message.mutable_controller() = change.controller();
  if (!change.terminations().empty()) *message.mutable_terminations() = change.terminations();
  return message;
}

void Skills::begin_change(Build& build) {
  const proto::ChangeSkill& change = build.request.change_skill();
  changed(build.from, change);
  const Running& running = running_.at(change.skill_id());
  realtime::Skill& skill = *build.skill;
  if (!(skill.settings == running.settings)) {
    refuse("the robot takes other settings (its own stiffness) at rest only: preempt the skill instead");
  }
  auto parts = std::make_unique<realtime::Change>();
  parts->skill_id = change.skill_id();
  parts->numbers = skill.numbers;
  const bool lets_go = !skill.controller->tracks();
  changing_ = Changing{build.from, change.skill_id(), std::move(build.message), running.goal, lets_go, build.made_at, {}};
  Listening& listening = changing_->listening;
  if (change.has_trajectory()) {
    changing_->goal = skill.trajectory->goal();
    listening.trajectory = skill.trajectory->sensor_inputs();
    parts->trajectory = std::move(skill.trajectory);
  }
  if (change.has_controller()) {
    listening.controller = skill.controller->sensor_inputs();
    parts->controller = std::move(skill.controller);
  }
  if (!change.terminations().empty()) {
    listening.terminations = inputs_of(skill.terminations);
    parts->terminations = std::move(skill.terminations);
    parts->changes_terminations = true;
  }
  parts->inputs = listening.all();
  sensors_.bind(change.skill_id(), parts->inputs, false, build.from.who.name, changing_->message.publishers());
  for (const auto part : {&Listening::trajectory, &Listening::controller, &Listening::terminations}) {
    const auto& before = running.listening.*part;
    if (!(listening.*part) && before) parts->inputs.insert(parts->inputs.end(), before->begin(), before->end());
  }
  door_.change.put(std::move(parts));
}

void Skills::check(const Address& from, proto::Request& request) {
  auto build = std::make_shared<Build>();
  build->from = from;
  build->connection = arm_.require();
  if (const auto& joints = request.check_skill().joints(); !joints.empty()) {
    build->before.end.emplace().motion = realtime::Channels::kJoint;
    build->before.end->joint.q = realtime::Vector7::Map(joints.data());
  } else {
    put_what_runs(build->before);
  }
  build->message.Swap(request.mutable_check_skill()->mutable_skill());
  put_on_workbench(std::move(build), &Skills::tell_checked);
}

void Skills::tell_checked(Build& build) {
  const realtime::Skill& skill = *build.skill;
  sensors_.check(build.message.publishers(), listening_of(skill).all());
  proto::Reply reply;
  auto& checked = *reply.mutable_skill_checked();
  if (skill.trajectory->has_end()) checked.set_duration(skill.trajectory->duration() / skill.speed);
  checked.set_stretch(skill.trajectory->stretch());
  checked.set_robot_controller(name_of(skill.mode));
  answers_.send(build.from, reply);
}

// Builds it there, and goes on with it here, where the robot is the same still.
void Skills::put_on_workbench(std::shared_ptr<Build> build, void (Skills::*go_on)(Build&)) {
  const Address from = build->from;
  jobs_.put(
      from,
      [this, build] { make(*build); },
      [this, build, go_on] {
        clients_.known(build->from);
        if (arm_.require().builder != build->connection.builder) {
          throw Refused(proto::Error::NOT_READY, "the robot was connected anew meanwhile: try again");
        }
        (this->*go_on)(*build);
      });
}

// On the workbench.
void Skills::make(Build& build) {
  SkillBuilder& builder = *build.connection.builder;
  const auto& walls = *build.connection.walls;
  builder.keep_from(std::make_unique<realtime::Walls>(walls.walls), walls.names);
  builder.keep_to(build.connection.limits);
  build.skill = builder.build(build.message, require_state(), build.before, build.made_at);
}

void Skills::take_changes() {
  while (realtime::Change* const* front = door_.changed.front()) {
    const std::unique_ptr<realtime::Change> change(*front);
    door_.changed.pop();
    if (!changing_) continue;
    Changing changing = std::move(*changing_);
    changing_.reset();
    if (!change->done) {
      sensors_.release(changing.skill, changing.listening.all());
      answers_.send_error(changing.from, proto::Error::NOT_READY,
                          fmt::format("skill {} has ended: it was not changed", changing.skill));
      continue;
    }
    if (const auto running = running_.find(changing.skill); running != running_.end()) {
      running->second.message = changing.message;
      running->second.goal = changing.goal;
      running->second.lets_go = changing.lets_go;
      running->second.made_at = changing.made_at;
      for (const auto part : {&Listening::trajectory, &Listening::controller, &Listening::terminations}) {
        if (!(changing.listening.*part)) continue;
        std::swap(running->second.listening.*part, changing.listening.*part);
        sensors_.release(changing.skill, *(changing.listening.*part));  // of what was replaced
      }
      proto::SkillEvent event;
      *event.mutable_changed() = running->second.message;
      publisher_.describe(changing.skill, running->second.message);
      note(event, changing.skill, changing.from);
    }
    answers_.send_done(changing.from);
  }
}

void Skills::hand_on_queued() {
  if (queue_.empty() || !door_.queued.empty()) return;
  door_.queued.put(std::move(queue_.front()));
  queue_.pop_front();
}

// Those that the loop has not taken yet.
void Skills::cancel_queue(realtime::Ending ending) {
  auto queue = std::exchange(queue_, {});
  if (realtime::Skill* skill = door_.queued.take()) queue.emplace_front(skill);
  for (const auto& skill : queue) end({.skill_id = skill->id, .ending = ending});
}

void Skills::stop(const Address& from) {
  door_.stop_up_to.store(last_skill_);
  recovery_.stop();
  cancel_queue(realtime::Ending::kStopped);
  answers_.send_done(from);
}

void Skills::tell_status(const Address& from, std::uint64_t id) {
  if (running_.contains(id)) return answers_.send_done(from);
  const auto result = results_.find(id);
  if (result == results_.end()) {
    refuse(fmt::format("SkillStatus.skill_id = {}: no such skill among the last {}", id, kMaxResults));
  }
  proto::Reply reply;
  *reply.mutable_skill_result() = result->second;
  answers_.send(from, reply);
}

void Skills::take_results() {
  while (const realtime::SkillResult* result = door_.results.front()) {
    // Whoever is told of the end reads a state that knows of it.
    if (result->record && *result->record >= door_.records.written()) break;
    take_changes();  // that came before it
    end(*result);
    door_.results.pop();
  }
  while (realtime::Skill* const* skill = door_.retired.front()) {
    delete *skill;
    door_.retired.pop();
  }
}

void Skills::end(const realtime::SkillResult& result) {
  const auto running = running_.find(result.skill_id);
  if (running == running_.end()) return;
  proto::Reply reply;
  auto& out = *reply.mutable_skill_result();
  convert(result, out);
  const auto& terminations = running->second.message.terminations();
  if (result.termination >= 0 && result.termination < terminations.size()) {
    out.set_termination(kind_of(terminations[result.termination]));
    out.set_termination_index(result.termination);
  }
  if (result.wall != 0) out.set_wall(arm_.wall_name(result.wall));
  if (out.ending() == proto::TERMINATED && (out.termination().empty() || out.termination() == "Time")) {
    out.set_message(explain(result.left));
  }
  realtime::Record record;
  if (result.record && door_.records.read(*result.record, record)) {
    *out.mutable_last_state() = publisher_.state(record);
  } else if (const auto newest = publisher_.newest()) {
    record = *newest;
    *out.mutable_last_state() = publisher_.state(record);
  }
  sensors_.release(result.skill_id);  // what is published by who then knows of the end is for the next
  if (running->second.client_is_gone) out.set_client_is_gone(true);
  const std::string why = worth_keeping(result, record);
  const std::string black_box = why.empty() ? running->second.black_box : recorder_.keep(why);
  if (!black_box.empty()) out.set_black_box(black_box);
  if (result.ending == realtime::Ending::kRobotError) {
    const proto::RecoveryPolicy policy = running->second.message.recovery();
    const std::uint64_t id = result.skill_id;
    recovery_.after_error(result, record, policy, [this, id, reply = std::move(reply)](const proto::Recovery& recovery) mutable {
      auto& out = *reply.mutable_skill_result();
      *out.mutable_recovery() = recovery;
      const char* ready = recovery.by_itself() ? "it has recovered by itself" : "it is ready";
      const std::string now = recovery.recovered() ? ready : recovery.message();
      out.set_message(fmt::format("{}: {}", out.message(), now));
      tell(id, reply);
    });
  } else {
    if (!running->second.done) recovery_.after(result.ending);
    tell(result.skill_id, reply);
  }
  if (result.ending != realtime::Ending::kTerminated && !queue_.empty() && queue_.front()->after == result.skill_id) {
    cancel_queue(realtime::Ending::kCancelled);
  }
}

// Its starter, and all who ask.
void Skills::tell(std::uint64_t id, proto::Reply& reply) {
  const auto found = running_.find(id);
  if (found == running_.end()) return;
  const Running running = std::move(found->second);
  running_.erase(found);
  proto::SkillResult& out = *reply.mutable_skill_result();
  if (!out.message().empty()) spdlog::warn("skill {}: {}", id, out.message());
  if (running.done) {
    const bool there = out.ending() == proto::TERMINATED;
    return running.done(there ? "" : fmt::format("it ended with {} {}", proto::Ending_Name(out.ending()), out.message()));
  }
  answers_.send(running.starter, reply);
  proto::SkillEvent event;
  *event.mutable_ended() = out;
  event.mutable_ended()->clear_last_state();
  note(event, id, running.starter);
  results_[id] = std::move(out);
  if (results_.size() > kMaxResults) results_.erase(results_.begin());
}

void Skills::client_is_gone(const std::string& black_box) {
  for (auto& [id, running] : running_) {
    running.client_is_gone = true;
    running.black_box = black_box;
  }
}

void Skills::abandon(const std::string& why) {
  take_results();
  queue_.clear();
  delete door_.next.take();
  delete door_.queued.take();
  delete door_.change.take();
  if (changing_) {
    sensors_.release(changing_->skill, changing_->listening.all());
    answers_.send_error(changing_->from, proto::Error::NOT_READY, why);
  }
  changing_.reset();
  while (!running_.empty()) {
    end({.skill_id = running_.begin()->first, .ending = realtime::Ending::kConnectionLost});
  }
}

realtime::Record Skills::require_state() const {
  const auto now = publisher_.newest();
  if (!now) throw Refused(proto::Error::NOT_READY, "no state of the robot yet: try again");
  return *now;
}

void Skills::note(proto::SkillEvent& event, std::uint64_t skill, const Address& from) {
  event.set_skill_id(skill);
  if (const std::string name = clients_.name(from); !name.empty()) event.set_client(name);
  recorder_.box().journal.note("/skills", event.GetTypeName(), event.SerializeAsString());
}

}  // namespace server
