#include "server/transport.hpp"

#include <google/protobuf/stubs/logging.h>
#include <spdlog/spdlog.h>

#include "server/convert.hpp"
#include "server/gripper.hpp"
#include "server/publisher.hpp"
#include "server/refused.hpp"
#include "server/sockets.hpp"
#include "server/validation.hpp"

namespace server {
namespace {

constexpr std::int64_t kMaxMessage = 4 << 20;  // bytes; a longer one ends its connection
constexpr std::size_t kMaxClients = 1024;  // remembered
constexpr std::size_t kMaxResults = 256;   // remembered
constexpr int kMessagesPerRound = 64;
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

std::string errors_of(const fci::RobotState& state) {
  if (fci::any(state.errors)) return fci::names(state.errors);
  if (fci::any(state.reflex_reason)) return fci::names(state.reflex_reason);
  switch (state.robot_mode) {
    case fci::RobotMode::kUserStopped: return "user stop is pressed";
    case fci::RobotMode::kGuiding: return "the arm is being guided by hand";
    case fci::RobotMode::kReflex: return "a reflex stopped it";
    case fci::RobotMode::kOther: return "it is locked or its FCI is not active";
    default: return "another program moves it";
  }
}

std::string explain(const realtime::RecoveryResult& result) {
  switch (result.robot_mode) {
    case fci::RobotMode::kUserStopped: return "the user stop is pressed: release it, then recover";
    case fci::RobotMode::kGuiding: return "the arm is being guided by hand: let go of the guiding button, then recover";
    default: break;
  }
  if (result.status == fci::Status::kFailed) return "the robot gave no answer to AutomaticErrorRecovery in time: try again";
  return fmt::format("the robot refused AutomaticErrorRecovery: {}. Look at its lights and its Desk page",
                     fci::name(result.status));
}

}  // namespace

Transport::Transport(zmq::context_t& context, const std::string& listen, std::uint16_t port, realtime::Door& door,
                     Publisher& publisher, Gripper* gripper)
    : door_(door), publisher_(publisher), gripper_(gripper), socket_(context, zmq::socket_type::router) {
  google::protobuf::SetLogHandler(nullptr);  // it writes a line for whatever it cannot read
  socket_.set(zmq::sockopt::linger, 200);
  socket_.set(zmq::sockopt::maxmsgsize, kMaxMessage);
  // A client that comes back under its old identity goes on where it was.
  socket_.set(zmq::sockopt::router_handover, true);
  endpoint_ = bind(socket_, listen, port);
}

Transport::~Transport() { take_results(); }

void Transport::run(const std::atomic<bool>& quit) {
  while (!quit) {
    const bool busy = !running_.empty() || !gripping_.empty() || !recovering_.empty();
    zmq::pollitem_t item{socket_.handle(), 0, ZMQ_POLLIN, 0};
    zmq::poll(&item, 1, busy ? kBusyWait : kIdleWait);
    take_disconnection();
    receive();
    take_results();
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
    handle(identity.to_string(), frame);
  }
}

void Transport::handle(const std::string& identity, const zmq::message_t& frame) {
  if (const auto client = clients_.find(identity); client != clients_.end()) {
    client->second.last_heard = Clock::now();
  }
  proto::Request request;
  const bool readable = request.ParsePartialFromArray(frame.data(), static_cast<int>(frame.size()));
  const Address from{identity, request.request_id()};
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
    answer(from, request);
  } catch (const Refused& refused) {
    spdlog::debug("refused: {}", refused.what());
    send_error(from, refused.code, refused.what());
  } catch (const std::exception& error) {
    spdlog::error("a request failed: {}", error.what());
    send_error(from, proto::Error::INTERNAL, fmt::format("the server failed on this request: {}", error.what()));
  }
}

void Transport::answer(const Address& from, proto::Request& request) {
  if (request.call_case() == proto::Request::kHello) return hello(from, request.hello());
  known(from);
  validate(request);
  switch (request.call_case()) {
    case proto::Request::kGetState: return get_state(from);
    case proto::Request::kStartSkill: return start_skill(from, request.start_skill());
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
  validate(checked);
  const Connection connection = require_connection();
  if (clients_.size() >= kMaxClients && !clients_.contains(from.client)) {
    const auto oldest = std::min_element(clients_.begin(), clients_.end(), [](const auto& a, const auto& b) {
      return a.second.last_heard < b.second.last_heard;
    });
    clients_.erase(oldest);
  }
  clients_[from.client] = {hello.client().substr(0, 256), Clock::now()};
  proto::Reply reply;
  auto& welcome = *reply.mutable_welcome();
  welcome = connection.welcome;
  welcome.set_version(proto::CURRENT);
  welcome.set_gripper(gripper_ != nullptr && gripper_->connected());
  welcome.set_state_endpoint(publisher_.endpoint());
  send(from, reply);
}

void Transport::get_state(const Address& from) {
  require_connection();
  auto state = publisher_.state();
  if (!state) throw Refused(proto::Error::NOT_READY, "no state of the robot yet: try again");
  proto::Reply reply;
  *reply.mutable_state() = std::move(*state);
  send(from, reply);
}

void Transport::start_skill(const Address& from, const proto::StartSkill& start) {
  require_lease(from);
  const Connection connection = require_connection();
  const auto now = publisher_.newest();
  if (!now) throw Refused(proto::Error::NOT_READY, "no state of the robot yet: try again");
  if (now->phase == realtime::Phase::kError) {
    throw Refused(proto::Error::NOT_READY,
                  fmt::format("the robot takes no motion: {}. Clear what caused it, then recover", errors_of(now->state)));
  }
  if (now->phase == realtime::Phase::kRecovering) {
    throw Refused(proto::Error::NOT_READY, "the robot is recovering from an error: wait until that is done");
  }
  for (const auto& [id, running] : running_) {
    if (running.starter.client != from.client || start.preempt()) continue;
    throw Refused(proto::Error::BUSY,
                  fmt::format("skill {} of this client still runs: wait for it, stop it, or set preempt", id));
  }
  auto skill = connection.builder->build(start.skill(), *now);

  take_lease(from);
  const std::uint64_t id = ++last_skill_;
  skill->id = id;
  Running running{from, {}};
  for (const auto& any : start.skill().terminations()) {
    running.terminations.push_back(any.type_url().substr(any.type_url().rfind('/') + 1));
  }
  publisher_.describe(id, start.skill().description());
  running_.emplace(id, std::move(running));
  if (const auto unread = door_.next.put(std::move(skill))) {
    end_skill({.skill_id = unread->id, .ending = realtime::Ending::kPreempted});
  }
  proto::Reply reply;
  reply.mutable_skill_started()->set_skill_id(id);
  send(from, reply);
}

void Transport::stop_skill(const Address& from) {
  door_.stop_up_to.store(last_skill_);
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
    std::string kind = terminations[result.termination];
    out.set_termination(kind.substr(kind.rfind('.') + 1));
  }
  if (auto state = publisher_.state()) *out.mutable_last_state() = std::move(*state);
  if (!out.message().empty()) spdlog::warn("skill {}: {}", result.skill_id, out.message());
  send(running->second.starter, reply);
  results_[result.skill_id] = std::move(*reply.mutable_skill_result());
  if (results_.size() > kMaxResults) results_.erase(results_.begin());
  running_.erase(running);
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
  delete door_.next.take();
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
  connection_ = {std::move(builder), welcome, ""};
}

void Transport::disconnected(const std::string& why) {
  const std::lock_guard lock(mutex_);
  disconnected_ = disconnected_ || connection_.builder != nullptr;
  connection_.builder = nullptr;
  connection_.why_not = why;
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

// --- clients and lease -------------------------------------------------------------------------------------------

Transport::Client& Transport::known(const Address& from) {
  const auto client = clients_.find(from.client);
  if (client == clients_.end()) {
    throw Refused(proto::Error::UNKNOWN_CLIENT,
                  "this client has not said Hello, or the arm's process was restarted since: say Hello first");
  }
  return client->second;
}

void Transport::require_lease(const Address& from) {
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
  if (holder != clients_.end() && Clock::now() - holder->second.last_heard < kLeaseTime) return;
  if (holder != clients_.end()) spdlog::info("{} is silent: the arm is free", holder->second.name);
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
