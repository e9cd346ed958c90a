#include "server/transport.hpp"

#include <google/protobuf/stubs/logging.h>
#include <spdlog/spdlog.h>

#include <array>
#include <optional>
#include <utility>

#include "server/clocks.hpp"
#include "server/gripper.hpp"
#include "server/publisher.hpp"
#include "server/realtime_setup.hpp"
#include "server/recorder.hpp"
#include "server/refused.hpp"
#include "server/roles.hpp"
#include "server/sensor_hub.hpp"
#include "server/sockets.hpp"
#include "wire/proto/validation.hpp"

namespace server {
namespace {

constexpr std::int64_t kCurve = 64;                      // bytes, more than encryption adds to a message
constexpr std::int64_t kMaxMessage = (8 << 20) + kCurve;  // more than two minutes of samples; a longer one ends its connection
constexpr int kMessagesPerRound = 32;
constexpr int kMessagesAhead = 64;                         // taken from a client's connection before they are looked at
constexpr auto kHandlingTime = std::chrono::microseconds(200);  // then it is looked again for what is urgent
constexpr auto kRecordingTime = std::chrono::seconds(4);  // of silence: a client that is alive has met this process anew by then
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

// Where a stop that overtakes it counts for it too.
bool may_move(int call) {
  return call == proto::Request::kStartSkill || call == proto::Request::kRecover || call == proto::Request::CALL_NOT_SET;
}

std::string set_up(zmq::socket_t& socket, const Listen& listen, std::uint16_t port) {
  socket.set(zmq::sockopt::linger, 200);
  socket.set(zmq::sockopt::maxmsgsize, kMaxMessage);
  socket.set(zmq::sockopt::rcvhwm, kMessagesAhead);
  // A client that comes back under its old identity goes on where it was.
  socket.set(zmq::sockopt::router_handover, true);
  return bind(socket, listen, port);
}

}  // namespace

Transport::Transport(zmq::context_t& context, const Listen& listen, std::uint16_t port, realtime::Door& door,
                     Publisher& publisher, SensorHub& sensors, Recorder& recorder, Gripper* gripper,
                     WallStore walls, LimitStore limits)
    : Transport(context, listen, port, door, publisher, sensors, recorder, gripper, std::move(walls), Options(),
                std::move(limits)) {}

Transport::Transport(zmq::context_t& context, const Listen& listen, std::uint16_t port, realtime::Door& door,
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
      clock_(std::move(options.clock)),
      answers_(socket_),
      inbox_(socket_, listen.keys),
      clients_(options.lease_time),
      arm_(door, std::move(walls), std::move(limits), gripper != nullptr),
      recovery_(door, arm_, options.recovery, [this](const auto& q, auto done) { skills_.move_back(q, std::move(done)); }),
      skills_(door, publisher, sensors, recorder, arm_, clients_, answers_, jobs_, recovery_),
      jobs_(answers_) {
  google::protobuf::SetLogHandler(nullptr);  // it writes a line for whatever it cannot read
}

void Transport::run(const std::atomic<bool>& quit) {
  const Preferred preferred;
  while (!quit) {
    const bool busy = skills_.busy() || !gripping_.empty() || recovery_.busy();
    std::array<zmq::pollitem_t, 2> items = {{{socket_.handle(), 0, ZMQ_POLLIN, 0}, {nullptr, jobs_.fd(), ZMQ_POLLIN, 0}}};
    zmq::poll(items, inbox_.waiting() > 0 ? std::chrono::milliseconds(0) : busy ? kBusyWait : kIdleWait);
    clients_.set_time(clock_ ? clock_() : wakeful_clock_.now());
    connections_.look();
    take_disconnection();
    receive();
    handle_waiting();
    jobs_.take_finished();
    skills_.take_results();
    skills_.take_changes();
    skills_.hand_on_queued();
    arm_.take_back();
    recovery_.take_results();
    take_gripper_results();
    record_for_those_there();
    if (clients_.expire_lease() && skills_.any_run()) skills_.client_is_gone(recorder_.keep("a-client-is-gone"));
    rounds_.fetch_add(1, std::memory_order_relaxed);
  }
}

// --- requests --------------------------------------------------------------------------------------------------

void Transport::receive() {
  for (int i = 0; i < kMessagesPerRound; ++i) {
    auto arrived = inbox_.receive();
    if (!arrived) return;
    if (arrived->who.role != proto::NOBODY) clients_.hear(arrived->client, arrived->who.key);  // a removed key's lease falls free
    take(*arrived);
  }
}

// What is urgent is done now; the rest waits for its turn.
void Transport::take(Arrived& arrived) {
  const Head head = arrived.head;
  if (head.call == proto::Request::kStopSkill && arrived.is_short()) return handle(arrived);
  if (may_move(head.call)) arrived.skill = skills_.next_id();
  if (inbox_.put(arrived)) return;
  if (!head.request_id) return inbox_.count_garbage("what came faster than it could be read");
  answers_.send_error({arrived.client, *head.request_id, arrived.who}, proto::Error::BUSY,
                      fmt::format("{} requests wait already: send fewer at a time", inbox_.waiting()));
}

void Transport::handle_waiting() {
  const auto until = Clock::now() + kHandlingTime;
  while (auto next = inbox_.take()) {
    if (next->is_short()) {
      handle(*next);
    } else {
      read_on_workbench(std::move(*next));
    }
    if (Clock::now() > until) return;
  }
}

void Transport::handle(const Arrived& arrived) {
  const zmq::message_t& frame = arrived.frame;
  proto::Request request;
  const bool readable = request.ParsePartialFromArray(frame.data(), static_cast<int>(frame.size()));
  const Address from{arrived.client, request.request_id(), arrived.who};
  if (!request.has_request_id()) {
    inbox_.count_garbage(fmt::format("{} bytes that are no Request with a request_id", frame.size()));
    return;
  }
  if (!readable) {
    inbox_.count_garbage(fmt::format("{} bytes that are no Request", frame.size()));
    answers_.send_error(from, proto::Error::INVALID_ARGUMENT,
                        fmt::format("{} bytes that cannot be read as a Request: expected one message of service.proto in one "
                                    "frame",
                                    frame.size()));
    return;
  }
  try {
    if (request.call_case() == proto::Request::kHello) return hello(from, request);
    take_time(clients_.known(from), request);
    wire::validate(request);
    answer(from, request, arrived.skill);
  } catch (...) {
    answers_.refuse(from, std::current_exception());
  }
}

// As handle(), but for what would take longer than what is urgent may wait.
void Transport::read_on_workbench(Arrived arrived) {
  struct Read {
    zmq::message_t frame;
    proto::Request request;
  };
  if (!arrived.head.request_id) {
    return inbox_.count_garbage(fmt::format("{} bytes that are no Request with a request_id", arrived.frame.size()));
  }
  const Address from{arrived.client, *arrived.head.request_id, arrived.who};
  try {
    clients_.known(from);
    const auto read = std::make_shared<Read>();
    read->frame = std::move(arrived.frame);
    jobs_.put(
        from,
        [read] {
          if (!read->request.ParsePartialFromArray(read->frame.data(), static_cast<int>(read->frame.size()))) {
            refuse(fmt::format("{} bytes that cannot be read as a Request: expected one message of service.proto in one frame",
                               read->frame.size()));
          }
          wire::validate(read->request);
        },
        [this, from, read, skill = arrived.skill] {
          // Others may have overtaken it, and ids grow; but not past a stop that came behind it.
          answer(from, read->request, skill <= door_.stop_up_to.load() ? skill : skills_.next_id());
        });
  } catch (...) {
    answers_.refuse(from, std::current_exception());
  }
}

void Transport::answer(const Address& from, proto::Request& request, std::uint64_t skill) {
  require_role(from.who, request);
  switch (request.call_case()) {
    case proto::Request::kGetState: return get_state(from);
    case proto::Request::kStartSkill: return skills_.start(from, request, skill);
    case proto::Request::kChangeSkill: return skills_.change(from, request);
    case proto::Request::kCheckSkill: return skills_.check(from, request);
    case proto::Request::kListTopics: return list_topics(from);
    case proto::Request::kGetServerStatus: return get_server_status(from);
    case proto::Request::kRecord: return record(from, request.record());
    case proto::Request::kChangeWalls: return change_walls(from, request.change_walls());
    case proto::Request::kChangeLimits: return change_limits(from, request.change_limits());
    case proto::Request::kStopSkill: return skills_.stop(from);
    case proto::Request::kSkillStatus: return skills_.tell_status(from, request.skill_status().skill_id());
    case proto::Request::kGripper: return start_gripper(from, request.gripper());
    case proto::Request::kRecover: return recover(from, request.recover(), skill);
    case proto::Request::kAlive: return answers_.send_done(from);
    case proto::Request::kGoodbye: return goodbye(from);
    case proto::Request::kListArms:
      refuse("Request.list_arms is for the supervisor: this is one arm's process");
    case proto::Request::kHello:
    case proto::Request::CALL_NOT_SET: break;
  }
  refuse("Request.call is missing: expected one of service.proto's calls");
}

void Transport::hello(const Address& from, const proto::Request& request) {
  const proto::Hello& hello = request.hello();
  require_role(from.who, request);
  if (!hello.has_version() || hello.version() != proto::CURRENT) {
    throw Refused(proto::Error::INCOMPATIBLE_VERSION,
                  fmt::format("the client speaks interface version {}, this server {}: install the same version of "
                              "frankapy and franka-interface",
                              version_name(hello), static_cast<int>(proto::CURRENT)));
  }
  proto::Hello checked = hello;
  wire::validate(checked);
  const ConnectedArm::Connection connection = arm_.require();
  clients_.come(from, hello.client());
  proto::Reply reply;
  auto& welcome = *reply.mutable_welcome();
  welcome = connection.welcome;
  welcome.set_version(proto::CURRENT);
  welcome.set_role(from.who.role);
  welcome.set_key(from.who.name);
  welcome.set_gripper(gripper_ != nullptr && gripper_->connected());
  welcome.set_state_endpoint(publisher_.endpoint());
  welcome.set_sensor_endpoint(sensors_.endpoint());
  answers_.send(from, reply);
}

void Transport::get_state(const Address& from) {
  arm_.require();
  proto::Reply reply;
  *reply.mutable_state() = publisher_.state(skills_.require_state());
  answers_.send(from, reply);
}

void Transport::list_topics(const Address& from) {
  proto::Reply reply;
  sensors_.describe(*reply.mutable_topics());
  answers_.send(from, reply);
}

void Transport::get_server_status(const Address& from) {
  proto::Reply reply;
  auto& status = *reply.mutable_server_status();
  clients_.describe(status);
  publisher_.describe(status);
  status.set_garbage(garbage());
  answers_.send(from, reply);
}

void Transport::record(const Address& from, const proto::Record& record) {
  if (record.on()) recording_for_.insert(from.client);
  if (record.has_on() && !record.on()) recording_for_.erase(from.client);
  proto::Record asked;
  if (record.has_on()) asked.set_on(!recording_for_.empty());
  proto::Reply reply;
  *reply.mutable_recording() = recorder_.ask(asked);
  answers_.send(from, reply);
}

// A client that was killed does not say that it is enough.
void Transport::record_for_those_there() {
  if (std::erase_if(recording_for_, [this](const std::string& client) { return clients_.is_silent(client, kRecordingTime); }) == 0) return;
  if (!recording_for_.empty()) return;
  proto::Record enough;
  enough.set_on(false);
  recorder_.ask(enough);
  spdlog::info("who asked for a recording is gone: it ends");
}

void Transport::change_walls(const Address& from, const proto::ChangeWalls& change) {
  if (change.remove_size() + change.put_size() == 0) return tell_walls(from);
  const bool lab = from.who.role == proto::LAB;  // protects the arm from whoever commands it
  if (!lab) clients_.require_lease(from);
  if (!keeping_.expired()) {
    throw Refused(proto::Error::BUSY, "walls that are to be kept are on their way to the disk: wait until they are there");
  }
  auto keep = arm_.keeping(change, from.who);
  if (!keep) {
    arm_.change(change, from.who);
    if (!lab) clients_.take_lease(from);
    return tell_walls(from);
  }
  // A disk may take its time, and others their stops meanwhile.
  const auto kept = std::make_shared<char>();
  jobs_.put(from, std::move(keep), [this, from, change, kept] {
    arm_.change(change, from.who);
    tell_walls(from);
  });
  keeping_ = kept;
  if (!lab) clients_.take_lease(from);
}

void Transport::tell_walls(const Address& from) {
  proto::Reply reply;
  proto::Walls& walls = *reply.mutable_walls();
  walls = arm_.walls();
  if (const auto now = publisher_.newest()) arm_.tell_nearer(realtime::Vector7::Map(now->state.q.data()), walls);
  answers_.send(from, reply);
}

void Transport::change_limits(const Address& from, const proto::ChangeLimits& change) {
  arm_.require();  // to an arm, of which they are
  const bool lab = from.who.role == proto::LAB;
  if (change.reset() || change.has_limits() || change.has_most()) {
    if (!lab) clients_.require_lease(from);
    arm_.change(change);
    if (!lab) clients_.take_lease(from);
  }
  proto::Reply reply;
  *reply.mutable_limits() = arm_.limits();
  answers_.send(from, reply);
}

void Transport::start_gripper(const Address& from, const proto::GripperCommand& command) {
  const bool stop = command.has_stop();  // from every client, as StopSkill
  if (!stop) clients_.require_lease(from);
  if (command.command_case() == proto::GripperCommand::COMMAND_NOT_SET) {
    refuse("GripperCommand.command is missing: expected homing, move, grasp or stop");
  }
  if (gripper_ == nullptr) {
    throw Refused(proto::Error::NOT_READY, "this arm is configured without a gripper: set gripper = true");
  }
  const std::uint64_t ticket = last_ticket_ + 1;
  gripper_->start(command, ticket);
  last_ticket_ = ticket;
  if (!stop) clients_.take_lease(from);
  gripping_[ticket] = from;
  proto::Reply reply;
  reply.mutable_gripper_started();
  answers_.send(from, reply);
}

void Transport::recover(const Address& from, const proto::Recover& recover, std::uint64_t id) {
  clients_.require_lease(from);
  arm_.require();
  clients_.take_lease(from);
  recovery_.ask(recover, id <= door_.stop_up_to.load(), skills_.require_state(), [this, from](const proto::Recovery& recovery) {
    proto::Reply reply;
    *reply.mutable_recovery() = recovery;
    answers_.send(from, reply);
  });
}

void Transport::goodbye(const Address& from) {
  answers_.send_done(from);
  clients_.leave(from);
}

// --- what comes from the other threads ---------------------------------------------------------------------------

void Transport::take_gripper_results() {
  if (gripper_ == nullptr) return;
  while (auto finished = gripper_->poll()) {
    const auto client = gripping_.find(finished->ticket);
    proto::Reply reply;
    *reply.mutable_gripper_result() = std::move(finished->result);
    answers_.send(client->second, reply);
    gripping_.erase(client);
  }
}

// The loop is gone.
void Transport::take_disconnection() {
  const auto why_not = arm_.lost();
  if (!why_not) return;
  skills_.take_results();  // of which some may want to recover
  recovery_.abandon(*why_not);
  skills_.abandon(*why_not);
  arm_.settle();
}

// And now and then recordings are told.
void Transport::take_time(Clients::Client& client, const proto::Request& request) {
  if (!request.has_sent_ns() || !ClockEstimate::is_time(request.sent_ns())) return;
  const std::int64_t now = since_epoch_ns(now_ns());
  client.clock.take(request.sent_ns(), now, request.way_ns());
  if (!client.clock.is_due(now)) return;
  proto::ClockDifference difference;
  difference.set_sender(client.name);
  client.clock.put(difference);
  recorder_.box().journal.note("/clocks", difference.GetTypeName(), difference.SerializeAsString());
}

}  // namespace server
