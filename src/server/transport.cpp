#include "server/transport.hpp"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/stubs/logging.h>
#include <spdlog/spdlog.h>

#include <array>
#include <optional>
#include <utility>

#include "server/clocks.hpp"
#include "server/convert.hpp"
#include "server/gripper.hpp"
#include "server/publisher.hpp"
#include "server/realtime_setup.hpp"
#include "server/recorder.hpp"
#include "server/registry.hpp"
#include "server/refused.hpp"
#include "server/sensor_hub.hpp"
#include "server/sockets.hpp"
#include "wire/proto/validation.hpp"

namespace server {
namespace {

constexpr std::int64_t kMaxMessage = 8 << 20;  // bytes, more than two minutes of samples; a longer one ends its connection
constexpr std::size_t kMaxClients = 1024;  // remembered
constexpr std::size_t kMaxResults = 256;   // remembered
constexpr std::size_t kMaxQueue = 256;
constexpr int kMessagesPerRound = 32;
constexpr std::size_t kMostWaiting = 1024;                 // requests; further ones are refused
constexpr std::size_t kMostWaitingBytes = 64 << 20;        // likewise
constexpr int kMessagesAhead = 64;                         // taken from a client's connection before they are looked at
constexpr std::size_t kShort = 16 << 10;                   // bytes of a request that is read at once
constexpr auto kHandlingTime = std::chrono::microseconds(200);  // then it is looked again for what is urgent
constexpr auto kBusyWait = std::chrono::milliseconds(1);
constexpr auto kIdleWait = std::chrono::milliseconds(20);

std::string version_name(const proto::Hello& hello) {
  if (hello.has_version()) return std::to_string(hello.version());
  // A number that this enum lacks ends up among the unknown fields.
  const auto& unknown = hello.GetReflection()->GetUnknownFields(hello);
  for (int i = 0; i < unknown.field_count(); ++i) {
    if (unknown.field(i).number() == proto::Hello::kVersionFieldNumber &&
        unknown.field(i).type() == google::protobuf::UnknownField::TYPE_VARINT) {
      return std::to_string(unknown.field(i).varint());
    }
  }
  return "none";
}

struct Head {
  std::optional<std::uint64_t> request_id;
  proto::Request::CallCase call = proto::Request::CALL_NOT_SET;  // or it cannot be seen so soon
};

// What the first fields of a request say: what is urgent is found without reading the rest, which may be megabytes.
Head head_of(const zmq::message_t& frame) {
  constexpr int kFields = 4;  // as a request has at most
  google::protobuf::io::CodedInputStream in(frame.data<std::uint8_t>(), static_cast<int>(frame.size()));
  Head head;
  for (int field = 0; field < kFields; ++field) {
    const std::uint32_t tag = in.ReadTag();
    const int number = static_cast<int>(tag >> 3);
    std::uint64_t value;
    std::uint32_t size;
    if (tag == 0) return head;
    switch (tag & 7) {
      case 0:
        if (!in.ReadVarint64(&value)) return head;
        if (number == proto::Request::kRequestIdFieldNumber) head.request_id = value;
        break;
      case 2:
        if (!in.ReadVarint32(&size) || !in.Skip(static_cast<int>(size))) return head;
        head.call = static_cast<proto::Request::CallCase>(number);  // the last one counts
        break;
      default: return head;
    }
  }
  if (in.ReadTag() != 0) head.call = proto::Request::CALL_NOT_SET;
  return head;
}

std::vector<std::string> kinds_of(const proto::Skill& skill) {
  std::vector<std::string> kinds;
  for (const auto& any : skill.terminations()) kinds.push_back(kind_of(any));
  return kinds;
}

std::vector<std::shared_ptr<realtime::SensorInput>> sensor_inputs(
    const realtime::TrajectoryGenerator& trajectory, const realtime::Controller& controller,
    const std::vector<std::unique_ptr<realtime::Termination>>& terminations) {
  auto all = trajectory.sensor_inputs();
  const auto add = [&all](const realtime::Part& part) {
    for (auto& input : part.sensor_inputs()) all.push_back(std::move(input));
  };
  add(controller);
  for (const auto& termination : terminations) add(*termination);
  return all;
}

std::string explain(const realtime::RecoveryResult& result) {
  switch (result.robot_mode) {
    case fci::RobotMode::kUserStopped: return "the user stop is pressed: release it, then recover";
    case fci::RobotMode::kGuiding: return "the arm is being guided by hand: let go of the guiding button, then recover";
    default: break;
  }
  if (result.accepted) {
    return "the robot took AutomaticErrorRecovery but is not ready to move: what has stopped it may be there still. Look whether "
           "the arm presses against something";
  }
  if (result.status == fci::Status::kFailed) return "the robot gave no answer to AutomaticErrorRecovery in time: try again";
  return fmt::format("the robot refused AutomaticErrorRecovery: {}. Look at its lights and its Desk page",
                     fci::name(result.status));
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
  return "the arm came to rest " + how + " away from its goal: does something hold it, do limits keep it from there, or are its gains too low?";
}

std::string set_up(zmq::socket_t& socket, const std::string& listen, std::uint16_t port) {
  socket.set(zmq::sockopt::linger, 200);
  socket.set(zmq::sockopt::maxmsgsize, kMaxMessage);
  socket.set(zmq::sockopt::rcvhwm, kMessagesAhead);
  // A client that comes back under its old identity goes on where it was.
  socket.set(zmq::sockopt::router_handover, true);
  return bind(socket, listen, port);
}

}  // namespace

Transport::Transport(zmq::context_t& context, const std::string& listen, std::uint16_t port, realtime::Door& door,
                     Publisher& publisher, SensorHub& sensors, Recorder& recorder, Gripper* gripper,
                     WallStore walls, LimitStore limits)
    : Transport(context, listen, port, door, publisher, sensors, recorder, gripper, std::move(walls), Options(),
                std::move(limits)) {}

Transport::Transport(zmq::context_t& context, const std::string& listen, std::uint16_t port, realtime::Door& door,
                     Publisher& publisher, SensorHub& sensors, Recorder& recorder, Gripper* gripper,
                     WallStore walls, Options options, LimitStore limits)
    : door_(door),
      publisher_(publisher),
      sensors_(sensors),
      recorder_(recorder),
      gripper_(gripper),
      socket_(context, zmq::socket_type::router),
      endpoint_(set_up(socket_, listen, port)),
      connections_(context, socket_),
      options_(std::move(options)),
      walls_(std::move(walls)),
      limits_(std::move(limits)) {
  google::protobuf::SetLogHandler(nullptr);  // it writes a line for whatever it cannot read
}

Transport::~Transport() {
  take_results();
  take_former_walls();
  take_taken_bounds();
}

void Transport::run(const std::atomic<bool>& quit) {
  const Preferred preferred;
  while (!quit) {
    const bool busy = !running_.empty() || !gripping_.empty() || !recovering_.empty() || changing_;
    std::array<zmq::pollitem_t, 2> items = {{{socket_.handle(), 0, ZMQ_POLLIN, 0}, {nullptr, workbench_.fd(), ZMQ_POLLIN, 0}}};
    zmq::poll(items, !waiting_.empty() ? std::chrono::milliseconds(0) : busy ? kBusyWait : kIdleWait);
    now_ = options_.clock ? options_.clock() : clock_.now();
    connections_.look();
    take_disconnection();
    receive();
    handle_waiting();
    workbench_.take_finished();
    take_results();
    take_changes();
    hand_on_queued();
    take_former_walls();
    take_taken_bounds();
    take_recoveries();
    take_gripper_results();
    expire_lease();
    rounds_.fetch_add(1, std::memory_order_relaxed);
  }
}

// --- requests --------------------------------------------------------------------------------------------------

void Transport::receive() {
  for (int i = 0; i < kMessagesPerRound; ++i) {
    zmq::message_t identity, frame;
    if (!socket_.recv(identity, zmq::recv_flags::dontwait)) return;
    int frames = 0;
    bool more = identity.more();
    while (more) {
      zmq::message_t next;
      if (!socket_.recv(next)) return;
      more = next.more();
      if (++frames == 1) frame = std::move(next);
    }
    if (frames != 1) {
      count_garbage(fmt::format("a message of {} frames (expected one)", frames));
      continue;
    }
    take(identity, frame);
  }
}

// What is urgent is done now; the rest waits for its turn.
void Transport::take(zmq::message_t& identity, zmq::message_t& frame) {
  Waiting waiting{identity.to_string(), std::move(frame), 0};
  if (const auto client = clients_.find(waiting.client); client != clients_.end()) client->second.last_heard = now_;
  const Head head = head_of(waiting.frame);
  if (head.call == proto::Request::kStopSkill && waiting.frame.size() <= kShort) return handle(waiting);
  if (waiting_.size() >= kMostWaiting || waiting_bytes_ + waiting.frame.size() > kMostWaitingBytes) {
    if (!head.request_id) return count_garbage("what came faster than it could be read");
    return send_error({waiting.client, *head.request_id}, proto::Error::BUSY,
                      fmt::format("{} requests wait already: send fewer at a time", waiting_.size()));
  }
  if (head.call == proto::Request::kStartSkill || head.call == proto::Request::CALL_NOT_SET) waiting.skill = ++last_skill_;
  waiting_bytes_ += waiting.frame.size();
  waiting_.push_back(std::move(waiting));
}

void Transport::handle_waiting() {
  const auto until = Clock::now() + kHandlingTime;
  while (!waiting_.empty()) {
    Waiting next = std::move(waiting_.front());
    waiting_.pop_front();
    waiting_bytes_ -= next.frame.size();
    if (next.frame.size() > kShort) {
      read_on_workbench(std::move(next));
    } else {
      handle(next);
    }
    if (Clock::now() > until) return;
  }
}

void Transport::handle(const Waiting& waiting) {
  const zmq::message_t& frame = waiting.frame;
  proto::Request request;
  const bool readable = request.ParsePartialFromArray(frame.data(), static_cast<int>(frame.size()));
  const Address from{waiting.client, request.request_id()};
  if (!request.has_request_id()) {
    count_garbage(fmt::format("{} bytes that are no Request with a request_id", frame.size()));
    return;
  }
  if (!readable) {
    count_garbage(fmt::format("{} bytes that are no Request", frame.size()));
    send_error(from, proto::Error::INVALID_ARGUMENT,
               fmt::format("{} bytes that cannot be read as a Request: expected one message of service.proto in one "
                           "frame",
                           frame.size()));
    return;
  }
  try {
    if (request.call_case() == proto::Request::kHello) return hello(from, request.hello());
    take_time(known(from), request);
    wire::validate(request);
    answer(from, request, waiting.skill);
  } catch (...) {
    refuse(from, std::current_exception());
  }
}

// As handle(), but for what would take longer than what is urgent may wait.
void Transport::read_on_workbench(Waiting waiting) {
  struct Read {
    zmq::message_t frame;
    proto::Request request;
  };
  const Head head = head_of(waiting.frame);
  if (!head.request_id) return count_garbage(fmt::format("{} bytes that are no Request with a request_id", waiting.frame.size()));
  const Address from{waiting.client, *head.request_id};
  try {
    known(from);
    const auto read = std::make_shared<Read>();
    read->frame = std::move(waiting.frame);
    put_on_workbench(
        from,
        [read] {
          if (!read->request.ParsePartialFromArray(read->frame.data(), static_cast<int>(read->frame.size()))) {
            throw Refused(proto::Error::INVALID_ARGUMENT,
                          fmt::format("{} bytes that cannot be read as a Request: expected one message of service.proto in one frame",
                                      read->frame.size()));
          }
          wire::validate(read->request);
        },
        [this, from, read, skill = waiting.skill] {
          // Others may have overtaken it, and ids grow; but not past a stop that came behind it.
          answer(from, read->request, skill <= door_.stop_up_to.load() ? skill : ++last_skill_);
        });
  } catch (...) {
    refuse(from, std::current_exception());
  }
}

// `work` there, and if it does not throw `done` here; what either throws is answered.
void Transport::put_on_workbench(const Address& from, std::function<void()> work, std::function<void()> done) {
  if (at_workbench_.contains(from.client)) {
    throw Refused(proto::Error::BUSY, "another request of this client is being looked at: wait for its answer");
  }
  const bool taken = workbench_.add({std::move(work), [this, from, done = std::move(done)](const std::exception_ptr& thrown) {
                                       at_workbench_.erase(from.client);
                                       try {
                                         if (thrown) std::rethrow_exception(thrown);
                                         done();
                                       } catch (...) {
                                         refuse(from, std::current_exception());
                                       }
                                     }});
  if (!taken) {
    throw Refused(proto::Error::BUSY, fmt::format("{} skills of other clients are being looked at: try again", Workbench::kMostJobs));
  }
  at_workbench_.insert(from.client);
}

void Transport::refuse(const Address& from, const std::exception_ptr& thrown) {
  try {
    std::rethrow_exception(thrown);
  } catch (const Refused& refused) {
    spdlog::debug("refused: {}", refused.what());
    send_error(from, refused.code, refused.what());
  } catch (const wire::Invalid& invalid) {
    spdlog::debug("refused: {}", invalid.what());
    send_error(from, proto::Error::INVALID_ARGUMENT, invalid.what());
  } catch (const std::exception& error) {
    spdlog::error("a request failed: {}", error.what());
    send_error(from, proto::Error::INTERNAL, fmt::format("the server failed on this request: {}", error.what()));
  }
}

void Transport::answer(const Address& from, proto::Request& request, std::uint64_t skill) {
  switch (request.call_case()) {
    case proto::Request::kGetState: return get_state(from);
    case proto::Request::kStartSkill: return start_skill(from, request, skill);
    case proto::Request::kChangeSkill: return change_skill(from, request);
    case proto::Request::kListTopics: return list_topics(from);
    case proto::Request::kGetServerStatus: return get_server_status(from);
    case proto::Request::kRecord: return record(from, request.record());
    case proto::Request::kChangeWalls: return change_walls(from, request.change_walls());
    case proto::Request::kChangeLimits: return change_limits(from, request.change_limits());
    case proto::Request::kStopSkill: return stop_skill(from);
    case proto::Request::kSkillStatus: return skill_status(from, request.skill_status().skill_id());
    case proto::Request::kGripper: return start_gripper(from, request.gripper());
    case proto::Request::kRecover: return recover(from);
    case proto::Request::kAlive: return send_done(from);
    case proto::Request::kGoodbye: return goodbye(from);
    case proto::Request::kListArms:
      throw Refused(proto::Error::INVALID_ARGUMENT, "Request.list_arms is for the supervisor: this is one arm's process");
    case proto::Request::kHello:
    case proto::Request::CALL_NOT_SET: break;
  }
  throw Refused(proto::Error::INVALID_ARGUMENT, "Request.call is missing: expected one of service.proto's calls");
}

void Transport::hello(const Address& from, const proto::Hello& hello) {
  if (!hello.has_version() || hello.version() != proto::CURRENT) {
    throw Refused(proto::Error::INCOMPATIBLE_VERSION,
                  fmt::format("the client speaks interface version {}, this server {}: install the same version of "
                              "frankapy and franka-interface",
                              version_name(hello), static_cast<int>(proto::CURRENT)));
  }
  proto::Hello checked = hello;
  wire::validate(checked);
  const Connection connection = require_connection();
  if (clients_.size() >= kMaxClients && !clients_.contains(from.client)) {
    const auto oldest = std::min_element(clients_.begin(), clients_.end(), [](const auto& a, const auto& b) {
      return a.second.last_heard < b.second.last_heard;
    });
    clients_.erase(oldest);
  }
  clients_[from.client] = {hello.client().substr(0, 256), now_, {}};
  proto::Reply reply;
  auto& welcome = *reply.mutable_welcome();
  welcome = connection.welcome;
  welcome.set_version(proto::CURRENT);
  welcome.set_gripper(gripper_ != nullptr && gripper_->connected());
  welcome.set_state_endpoint(publisher_.endpoint());
  welcome.set_sensor_endpoint(sensors_.endpoint());
  send(from, reply);
}

void Transport::get_state(const Address& from) {
  require_connection();
  proto::Reply reply;
  *reply.mutable_state() = publisher_.state(require_state());
  send(from, reply);
}

void Transport::start_skill(const Address& from, proto::Request& request, std::uint64_t id) {
  auto build = std::make_shared<Build>();
  const Before before = this->before(from, request.start_skill());
  build->from = from;
  build->connection = require_connection();
  build->message.Swap(request.mutable_start_skill()->mutable_skill());
  build->skill_id = id;
  if (before.queued) build->after = running_.at(request.start_skill().after()).goal;
  build->request = std::move(request);
  put_on_workbench(std::move(build), &Transport::begin_skill);
}

// Throws Refused where a skill of this client cannot be started now.
Transport::Before Transport::before(const Address& from, const proto::StartSkill& start) const {
  require_lease(from);
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
    throw Refused(proto::Error::INVALID_ARGUMENT, "StartSkill has preempt and after: expected one of the two");
  }
  if (after != 0 && after != last && ended == results_.end()) {
    throw Refused(proto::Error::INVALID_ARGUMENT,
                  fmt::format("StartSkill.after = {}: expected the last skill of this client{}", after,
                              last != 0 ? fmt::format(", {}", last) : ""));
  }
  if (last != 0 && after != last && !start.preempt()) {
    throw Refused(proto::Error::BUSY, fmt::format("skill {} of this client still runs: wait for it, stop it, preempt it or "
                                                  "queue behind it",
                                                  last));
  }
  if (queue_.size() >= kMaxQueue) {
    throw Refused(proto::Error::BUSY, fmt::format("{} skills are queued already: wait for one to end", queue_.size()));
  }
  const bool queued = after != 0 && after == last;
  return {queued, !queued && after != 0 && ended->second.ending() != proto::TERMINATED};
}

// One that is built. Meanwhile another client may have taken the lease, or the skill before it may have ended.
void Transport::begin_skill(Build& build) {
  const Address& from = build.from;
  const proto::StartSkill& start = build.request.start_skill();
  const Before before = this->before(from, start);
  take_lease(from);
  auto skill = std::move(build.skill);
  const std::uint64_t id = skill->id = build.skill_id;
  if (before.queued) skill->after = start.after();
  skill->blend = start.blend();
  publisher_.describe(id, build.message.description());
  proto::SkillEvent event;
  event.mutable_started()->Swap(&build.message);
  note(event, id, from);
  Running running{from, kinds_of(event.started()), skill->trajectory->goal(), std::move(*event.mutable_started()), skill->mode,
                  skill->settings};
  if (!before.queued) cancel_queue(realtime::Ending::kPreempted);
  running_.emplace(id, std::move(running));
  sensors_.bind(id, sensor_inputs(*skill->trajectory, *skill->controller, skill->terminations), before.queued);
  std::unique_ptr<realtime::Skill> unread;
  if (before.queued) {
    queue_.push_back(std::move(skill));
    hand_on_queued();
  } else if (!before.cancelled) {
    unread = door_.next.put(std::move(skill));
  }
  proto::Reply reply;
  reply.mutable_skill_started()->set_skill_id(id);
  send(from, reply);
  if (before.cancelled) end_skill({.skill_id = id, .ending = realtime::Ending::kCancelled});
  if (unread) end_skill({.skill_id = unread->id, .ending = realtime::Ending::kPreempted});
}

// What the running skill is with other parts, of which only these are handed to the loop.
void Transport::change_skill(const Address& from, proto::Request& request) {
  auto build = std::make_shared<Build>();
  build->from = from;
  build->message = changed(from, request.change_skill());
  build->connection = require_connection();
  build->path = request.change_skill().has_trajectory();
  build->request = std::move(request);
  put_on_workbench(std::move(build), &Transport::begin_change);
}

// What the skill is then. Throws Refused where it cannot be changed now.
proto::Skill Transport::changed(const Address& from, const proto::ChangeSkill& change) const {
  require_lease(from);
  require_state();
  const auto running = running_.find(change.skill_id());
  if (running == running_.end() || running->second.starter.client != from.client) {
    throw Refused(proto::Error::INVALID_ARGUMENT,
                  fmt::format("ChangeSkill.skill_id = {}: no skill of this client that runs", change.skill_id()));
  }
  if (!change.has_trajectory() && !change.has_controller() && change.terminations().empty()) {
    throw Refused(proto::Error::INVALID_ARGUMENT, "ChangeSkill changes nothing: expected trajectory, controller or terminations");
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

void Transport::begin_change(Build& build) {
  const proto::ChangeSkill& change = build.request.change_skill();
  changed(build.from, change);
  const Running& running = running_.at(change.skill_id());
  realtime::Skill& skill = *build.skill;
  if (!(skill.settings == running.settings)) {
    throw Refused(proto::Error::INVALID_ARGUMENT,
                  "the robot takes other settings (its own stiffness) at rest only: preempt the skill instead");
  }
  auto parts = std::make_unique<realtime::Change>();
  parts->skill_id = change.skill_id();
  parts->numbers = skill.numbers;
  changing_ = Changing{build.from, change.skill_id(), std::move(build.message), running.goal, {}};
  const auto listen = [this](const realtime::Part& part) {
    for (auto& input : part.sensor_inputs()) changing_->inputs.push_back(std::move(input));
  };
  if (change.has_trajectory()) {
    changing_->goal = skill.trajectory->goal();
    listen(*skill.trajectory);
    parts->trajectory = std::move(skill.trajectory);
  }
  if (change.has_controller()) {
    listen(*skill.controller);
    parts->controller = std::move(skill.controller);
  }
  if (!change.terminations().empty()) {
    for (const auto& termination : skill.terminations) listen(*termination);
    parts->terminations = std::move(skill.terminations);
    parts->changes_terminations = true;
  }
  sensors_.bind(change.skill_id(), changing_->inputs, false);
  door_.change.put(std::move(parts));
}

// Builds it there, and goes on with it here, where the robot is the same still.
void Transport::put_on_workbench(std::shared_ptr<Build> build, void (Transport::*go_on)(Build&)) {
  const Address from = build->from;
  put_on_workbench(
      from,
      [this, build] {
        SkillBuilder& builder = *build->connection.builder;
        const auto& walls = *build->connection.walls;
        builder.keep_from(std::make_unique<realtime::Walls>(walls.walls), walls.names);
        builder.keep_to(build->connection.limits);
        build->skill = builder.build(build->message, require_state(), build->after ? &*build->after : nullptr, build->path);
      },
      [this, build, go_on] {
        known(build->from);
        if (require_connection().builder != build->connection.builder) {
          throw Refused(proto::Error::NOT_READY, "the robot was connected anew meanwhile: try again");
        }
        (this->*go_on)(*build);
      });
}

void Transport::take_changes() {
  while (realtime::Change* const* front = door_.changed.front()) {
    const std::unique_ptr<realtime::Change> change(*front);
    door_.changed.pop();
    if (!changing_) continue;
    const Changing changing = std::move(*changing_);
    changing_.reset();
    if (!change->done) {
      send_error(changing.from, proto::Error::NOT_READY,
                 fmt::format("skill {} has ended: it was not changed", changing.skill));
      continue;
    }
    if (const auto running = running_.find(changing.skill); running != running_.end()) {
      running->second.message = changing.message;
      running->second.terminations = kinds_of(changing.message);
      running->second.goal = changing.goal;
      proto::SkillEvent event;
      *event.mutable_changed() = running->second.message;
      note(event, changing.skill, changing.from);
    }
    send_done(changing.from);
  }
}

void Transport::list_topics(const Address& from) {
  proto::Reply reply;
  sensors_.describe(*reply.mutable_topics());
  send(from, reply);
}

void Transport::get_server_status(const Address& from) {
  proto::Reply reply;
  auto& status = *reply.mutable_server_status();
  if (const auto holder = clients_.find(commander_); holder != clients_.end()) status.set_commander(holder->second.name);
  status.set_clients(static_cast<std::uint32_t>(clients_.size()));
  publisher_.describe(status);
  status.set_garbage(garbage());
  send(from, reply);
}

void Transport::record(const Address& from, const proto::Record& record) {
  proto::Reply reply;
  *reply.mutable_recording() = recorder_.ask(record);
  send(from, reply);
}

void Transport::change_walls(const Address& from, const proto::ChangeWalls& change) {
  proto::Reply reply;
  {
    const std::lock_guard lock(mutex_);
    if (change.remove_size() + change.put_size() > 0) {
      require_lease(from);
      walls_.change(change);
      take_lease(from);
      hand_on_walls();
    }
    *reply.mutable_walls() = walls_.list();
  }
  send(from, reply);
}

// To the loop and to the builder, where there are any. With mutex_ locked.
void Transport::hand_on_walls() {
  if (connection_.builder == nullptr) return;
  auto walls = walls_.make(models::arm(connection_.welcome.model()), gripper_ != nullptr);
  connection_.walls = std::make_shared<const WallsForBuilder>(WallsForBuilder{*walls, walls_});
  door_.walls.put(std::move(walls));
}

void Transport::change_limits(const Address& from, const proto::ChangeLimits& change) {
  require_connection();  // to an arm, of which they are
  proto::Reply reply;
  {
    const std::lock_guard lock(mutex_);
    if (change.reset() || change.has_limits()) {
      require_lease(from);
      limits_.change(change);
      take_lease(from);
      hand_on_limits();
    }
    *reply.mutable_limits() = limits_.list();
  }
  send(from, reply);
}

// As hand_on_walls().
void Transport::hand_on_limits() {
  if (connection_.builder == nullptr) return;
  const realtime::Bounds bounds = limits_.make();
  connection_.limits = bounds.limits;
  door_.bounds.put(std::make_unique<realtime::Bounds>(bounds));
}

void Transport::take_taken_bounds() {
  while (realtime::Bounds* const* taken = door_.taken_bounds.front()) {
    delete *taken;
    door_.taken_bounds.pop();
  }
}

void Transport::take_former_walls() {
  while (realtime::Walls* const* former = door_.former_walls.front()) {
    delete *former;
    door_.former_walls.pop();
  }
}

void Transport::hand_on_queued() {
  if (queue_.empty() || !door_.queued.empty()) return;
  door_.queued.put(std::move(queue_.front()));
  queue_.pop_front();
}

// Those that the loop has not taken yet.
void Transport::cancel_queue(realtime::Ending ending) {
  auto queue = std::exchange(queue_, {});
  if (realtime::Skill* skill = door_.queued.take()) queue.emplace_front(skill);
  for (const auto& skill : queue) end_skill({.skill_id = skill->id, .ending = ending});
}

void Transport::stop_skill(const Address& from) {
  door_.stop_up_to.store(last_skill_);
  cancel_queue(realtime::Ending::kStopped);
  send_done(from);
}

void Transport::skill_status(const Address& from, std::uint64_t id) {
  if (running_.contains(id)) return send_done(from);
  const auto result = results_.find(id);
  if (result == results_.end()) {
    throw Refused(proto::Error::INVALID_ARGUMENT,
                  fmt::format("SkillStatus.skill_id = {}: no such skill among the last {}", id, kMaxResults));
  }
  proto::Reply reply;
  *reply.mutable_skill_result() = result->second;
  send(from, reply);
}

void Transport::start_gripper(const Address& from, const proto::GripperCommand& command) {
  const bool stop = command.has_stop();  // from every client, as StopSkill
  if (!stop) require_lease(from);
  if (command.command_case() == proto::GripperCommand::COMMAND_NOT_SET) {
    throw Refused(proto::Error::INVALID_ARGUMENT, "GripperCommand.command is missing: expected homing, move, grasp or stop");
  }
  if (gripper_ == nullptr) {
    throw Refused(proto::Error::NOT_READY, "this arm is configured without a gripper: set gripper = true");
  }
  const std::uint64_t ticket = last_ticket_ + 1;
  gripper_->start(command, ticket);
  last_ticket_ = ticket;
  if (!stop) take_lease(from);
  gripping_[ticket] = from;
  proto::Reply reply;
  reply.mutable_gripper_started();
  send(from, reply);
}

void Transport::recover(const Address& from) {
  require_lease(from);
  require_connection();
  take_lease(from);
  recovering_.push_back(from);
  door_.recover.store(true);
}

void Transport::goodbye(const Address& from) {
  send_done(from);
  clients_.erase(from.client);
  if (commander_ == from.client) commander_.clear();
}

// --- what comes from the other threads ---------------------------------------------------------------------------

void Transport::take_results() {
  while (const realtime::SkillResult* result = door_.results.front()) {
    // Whoever is told of the end reads a state that knows of it.
    if (result->record && *result->record >= door_.records.written()) break;
    take_changes();  // that came before it
    end_skill(*result);
    door_.results.pop();
  }
  while (realtime::Skill* const* skill = door_.retired.front()) {
    delete *skill;
    door_.retired.pop();
  }
}

void Transport::end_skill(const realtime::SkillResult& result) {
  const auto running = running_.find(result.skill_id);
  if (running == running_.end()) return;
  proto::Reply reply;
  auto& out = *reply.mutable_skill_result();
  convert(result, out);
  const auto& terminations = running->second.terminations;
  if (result.termination >= 0 && result.termination < static_cast<int>(terminations.size())) {
    out.set_termination(terminations[result.termination]);
    out.set_termination_index(result.termination);
  }
  if (result.wall != 0) out.set_wall(walls_.name(result.wall));
  if (out.ending() == proto::TERMINATED && (out.termination().empty() || out.termination() == "Time")) {
    out.set_message(explain(result.left));
  }
  realtime::Record record;
  if (result.record && door_.records.read(*result.record, record)) {
    *out.mutable_last_state() = publisher_.state(record);
  } else if (const auto newest = publisher_.newest()) {
    *out.mutable_last_state() = publisher_.state(*newest);
  }
  if (!out.message().empty()) spdlog::warn("skill {}: {}", result.skill_id, out.message());
  sensors_.release(result.skill_id);  // what is published by who then knows of the end is for the next
  send(running->second.starter, reply);
  if (result.ending == realtime::Ending::kComponentFault) recorder_.keep("component-fault");
  proto::SkillEvent event;
  *event.mutable_ended() = reply.skill_result();
  event.mutable_ended()->clear_last_state();
  note(event, result.skill_id, running->second.starter);
  results_[result.skill_id] = std::move(*reply.mutable_skill_result());
  if (results_.size() > kMaxResults) results_.erase(results_.begin());
  running_.erase(running);
  if (result.ending != realtime::Ending::kTerminated && !queue_.empty() && queue_.front()->after == result.skill_id) {
    cancel_queue(realtime::Ending::kCancelled);
  }
}

void Transport::take_recoveries() {
  while (const realtime::RecoveryResult* result = door_.recoveries.front()) {
    for (const Address& client : recovering_) {
      if (result->recovered) {
        send_done(client);
      } else {
        send_error(client, proto::Error::NOT_READY, "not recovered: " + explain(*result));
      }
    }
    recovering_.clear();
    door_.recoveries.pop();
  }
}

void Transport::take_gripper_results() {
  if (gripper_ == nullptr) return;
  while (auto finished = gripper_->poll()) {
    const auto client = gripping_.find(finished->ticket);
    proto::Reply reply;
    *reply.mutable_gripper_result() = std::move(finished->result);
    send(client->second, reply);
    gripping_.erase(client);
  }
}

// The loop is gone: what is still at the door or waited for will not be answered by it.
void Transport::take_disconnection() {
  std::string why_not;
  {
    const std::lock_guard lock(mutex_);
    if (!disconnected_) return;
    why_not = connection_.why_not;
  }
  take_results();
  queue_.clear();
  delete door_.next.take();
  delete door_.queued.take();
  delete door_.change.take();
  if (changing_) send_error(changing_->from, proto::Error::NOT_READY, why_not);
  changing_.reset();
  door_.recover.store(false);
  while (!running_.empty()) {
    end_skill({.skill_id = running_.begin()->first, .ending = realtime::Ending::kConnectionLost});
  }
  for (const Address& client : recovering_) {
    send_error(client, proto::Error::NOT_READY, "not recovered: " + why_not);
  }
  recovering_.clear();
  {
    const std::lock_guard lock(mutex_);
    disconnected_ = false;
  }
  settled_.notify_all();
}

void Transport::connected(std::shared_ptr<SkillBuilder> builder, const proto::Welcome& welcome) {
  std::unique_lock lock(mutex_);
  settled_.wait_for(lock, std::chrono::seconds(1), [this] { return !disconnected_; });
  limits_.connect(builder->limits_of_loop());
  connection_ = {std::move(builder), nullptr, {}, welcome, ""};
  hand_on_walls();
  hand_on_limits();
}

void Transport::disconnected(const std::string& why) {
  const std::lock_guard lock(mutex_);
  disconnected_ = disconnected_ || connection_.builder != nullptr;
  connection_.builder = nullptr;
  connection_.why_not = why;
}

realtime::Record Transport::require_state() const {
  const auto now = publisher_.newest();
  if (!now) throw Refused(proto::Error::NOT_READY, "no state of the robot yet: try again");
  return *now;
}

Transport::Connection Transport::require_connection() const {
  Connection connection;
  {
    const std::lock_guard lock(mutex_);
    connection = connection_;
  }
  if (!connection.builder) throw Refused(proto::Error::NOT_READY, connection.why_not);
  return connection;
}

void Transport::note(proto::SkillEvent& event, std::uint64_t skill, const Address& from) {
  event.set_skill_id(skill);
  if (const auto client = clients_.find(from.client); client != clients_.end()) event.set_client(client->second.name);
  recorder_.box().journal.note("/skills", event.GetTypeName(), event.SerializeAsString());
}

// --- clients and lease -------------------------------------------------------------------------------------------

// And now and then recordings are told.
void Transport::take_time(Client& client, const proto::Request& request) {
  if (!request.has_sent_ns()) return;
  const std::int64_t now = since_epoch_ns(now_ns());
  client.clock.take(request.sent_ns(), now, request.way_ns());
  if (!client.clock.is_due(now)) return;
  proto::ClockDifference difference;
  difference.set_sender(client.name);
  client.clock.put(difference);
  recorder_.box().journal.note("/clocks", difference.GetTypeName(), difference.SerializeAsString());
}

Transport::Client& Transport::known(const Address& from) {
  const auto client = clients_.find(from.client);
  if (client == clients_.end()) {
    throw Refused(proto::Error::UNKNOWN_CLIENT,
                  "this client has not said Hello, or the arm's process was restarted since: say Hello first");
  }
  return client->second;
}

void Transport::require_lease(const Address& from) const {
  if (commander_.empty() || commander_ == from.client) return;
  const auto holder = clients_.find(commander_);
  throw Refused(proto::Error::BUSY,
                fmt::format("another client commands this arm: {}. It is free when that one has ended or said Goodbye",
                            holder == clients_.end() ? "unnamed" : holder->second.name));
}

void Transport::take_lease(const Address& from) {
  if (commander_ == from.client) return;
  commander_ = from.client;
  spdlog::info("{} commands the arm", known(from).name);
}

void Transport::expire_lease() {
  if (commander_.empty()) return;
  const auto holder = clients_.find(commander_);
  if (holder != clients_.end() && now_ - holder->second.last_heard < options_.lease_time) return;
  if (holder != clients_.end()) spdlog::info("{} is silent: the arm is free", holder->second.name);
  if (!running_.empty()) recorder_.keep("a-client-is-gone");  // in the middle of its skill
  commander_.clear();
}

// --- answers -------------------------------------------------------------------------------------------------------

void Transport::send(const Address& to, proto::Reply& reply) {
  reply.set_request_id(to.request_id);
  const std::string bytes = reply.SerializeAsString();
  // To a client that is gone or does not read, nothing is sent; nobody waits.
  try {
    socket_.send(zmq::buffer(to.client), zmq::send_flags::sndmore | zmq::send_flags::dontwait);
    socket_.send(zmq::buffer(bytes), zmq::send_flags::dontwait);
  } catch (const zmq::error_t& error) {
    spdlog::debug("a reply was not sent: {}", error.what());
  }
}

void Transport::send_error(const Address& to, proto::Error::Code code, const std::string& message) {
  proto::Reply reply;
  reply.mutable_error()->set_code(code);
  reply.mutable_error()->set_message(message);
  send(to, reply);
}

void Transport::send_done(const Address& to) {
  proto::Reply reply;
  reply.mutable_done();
  send(to, reply);
}

void Transport::count_garbage(const std::string& what) {
  const auto count = garbage_.fetch_add(1) + 1;
  if (const auto now = Clock::now(); now - garbage_told_ > std::chrono::seconds(1)) {
    garbage_told_ = now;
    spdlog::warn("dropped {}; {} messages like that so far", what, count);
  }
}

}  // namespace server
