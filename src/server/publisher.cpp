#include "server/publisher.hpp"

#include <spdlog/spdlog.h>

#include <chrono>

#include "server/convert.hpp"
#include "server/gripper.hpp"
#include "server/sockets.hpp"

namespace server {

namespace proto = frankapy::proto;

namespace {

constexpr auto kPeriod = std::chrono::microseconds(500);
constexpr auto kTell = std::chrono::seconds(1);
constexpr std::size_t kDescriptionsKept = 64;

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace

Publisher::Publisher(zmq::context_t& context, const std::string& listen, std::uint16_t port, realtime::Door& door,
                     Gripper* gripper)
    : door_(door), gripper_(gripper), socket_(context, zmq::socket_type::xpub) {
  socket_.set(zmq::sockopt::linger, 0);
  socket_.set(zmq::sockopt::sndhwm, 1000);
  socket_.set(zmq::sockopt::xpub_verbose, 0);
  endpoint_ = bind(socket_, listen, port);
  thread_ = std::thread([this] { run(); });
}

Publisher::~Publisher() {
  quit_ = true;
  thread_.join();
}

void Publisher::run() {
  std::uint64_t lost = 0;  // told of
  auto told = std::chrono::steady_clock::now();
  while (!quit_) {
    take_subscriptions();
    while (const realtime::Record* record = door_.records.front()) {
      if (subscriptions_ > 0) publish(*record);
      const std::lock_guard lock(mutex_);
      newest_ = *record;
      door_.records.pop();
    }
    const auto now = std::chrono::steady_clock::now();
    if (const std::uint64_t all = door_.records_lost.load(); all != lost && now - told > kTell) {
      spdlog::warn("{} states were not published: this computer is too busy", all - lost);
      lost = all;
      told = now;
    }
    std::this_thread::sleep_for(kPeriod);
  }
}

// XPUB tells who subscribes: a first byte of 1, or 0 for the end of it; only first and last of a topic.
void Publisher::take_subscriptions() {
  zmq::message_t message;
  while (socket_.recv(message, zmq::recv_flags::dontwait)) {
    if (message.size() == 0) continue;
    const char kind = *message.data<char>();
    if (kind == 1) ++subscriptions_;
    if (kind == 0 && subscriptions_ > 0) --subscriptions_;
  }
}

void Publisher::publish(const realtime::Record& record) {
  convert(record, message_);
  {
    const std::lock_guard lock(mutex_);
    add_rest(record, message_);
  }
  message_.SerializeToString(&bytes_);
  socket_.send(zmq::buffer(bytes_), zmq::send_flags::dontwait);
}

// With mutex_ locked.
void Publisher::add_rest(const realtime::Record& record, proto::ArmState& state) const {
  const auto description = descriptions_.find(record.skill_id);
  if (description != descriptions_.end()) {
    state.set_skill_description(description->second);
  } else {
    state.clear_skill_description();
  }
  state.clear_gripper();
  if (gripper_ != nullptr) gripper_->put_state(state);
  state.set_age((now_ns() - record.received_ns) * 1e-9);
}

std::optional<realtime::Record> Publisher::newest() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

std::optional<proto::ArmState> Publisher::state() const {
  const std::lock_guard lock(mutex_);
  if (!newest_) return std::nullopt;
  proto::ArmState state;
  convert(*newest_, state);
  add_rest(*newest_, state);
  return state;
}

void Publisher::describe(std::uint64_t id, const std::string& description) {
  const std::lock_guard lock(mutex_);
  descriptions_[id] = description;
  if (id > kDescriptionsKept) descriptions_.erase(id - kDescriptionsKept);
}

}  // namespace server
