#include "server/publisher.hpp"

#include <google/protobuf/util/field_mask_util.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <chrono>
#include <system_error>
#include <utility>

#include "server/clocks.hpp"
#include "server/convert.hpp"
#include "server/gripper.hpp"
#include "server/registry.hpp"

namespace server {

namespace proto = frankapy::proto;

namespace {

constexpr auto kPublishPeriod = std::chrono::microseconds(500);
constexpr auto kTellLostEvery = std::chrono::seconds(1);
constexpr int kSendQueue = 10'000;  // states that a subscriber may be behind: 10 s
constexpr std::size_t kMostTopics = 128;          // choices of rate and fields, of all subscribers
constexpr std::size_t kMostOfOne = 16;            // of a connection
constexpr std::size_t kMostUnserved = 256;        // subscriptions that are held although nothing is published to them
constexpr std::int64_t kLongestSubscription = 2048;  // bytes: all fields by name are less
constexpr int kSubscriptionsAhead = 64;           // read from a connection before they are looked at
constexpr std::size_t kDescriptionsKept = 512;
constexpr std::int64_t kLateCycle = 1'500'000;  // ns after the one before

}  // namespace

Publisher::Publisher(zmq::context_t& context, const Listen& listen, std::uint16_t port, realtime::Door& door,
                     Gripper* gripper)
    : ring_(door.records), records_(ring_), gripper_(gripper), socket_(context, zmq::socket_type::xpub) {
  socket_.set(zmq::sockopt::linger, 0);
  socket_.set(zmq::sockopt::sndhwm, kSendQueue);
  socket_.set(zmq::sockopt::rcvhwm, kSubscriptionsAhead);
  socket_.set(zmq::sockopt::maxmsgsize, kLongestSubscription);
  socket_.set(zmq::sockopt::xpub_verboser, 1);
  endpoint_ = bind(socket_, listen, port);
  connections_.emplace(context, socket_);
  thread_ = std::thread([this] { run(); });
}

Publisher::~Publisher() {
  quit_ = true;
  thread_.join();
}

void Publisher::run() {
  realtime::Record record;
  std::uint64_t lost = 0;  // told of
  auto told = std::chrono::steady_clock::now();
  while (!quit_) {
    take_subscriptions();
    // What there is now: where that takes longer than a cycle, more comes without end.
    const std::uint64_t end = ring_.written();
    while (records_.position() < end && records_.next(record)) {
      count_late(record);
      if (!topics_.empty()) publish(record);
    }
    const auto now = std::chrono::steady_clock::now();
    if (const std::uint64_t all = records_.lost(); all != lost && now - told > kTellLostEvery) {
      spdlog::warn("{} states were not published: this computer is too busy", all - lost);
      lost = all;
      told = now;
    }
    std::this_thread::sleep_for(kPublishPeriod);
  }
}

// XPUB tells of each subscription and each cancel: a first byte of 1 or 0, and which connection it came from. When a connection
// ends, it cancels what that had, from none.
void Publisher::take_subscriptions() {
  const auto look = [this] { connections_->look([this](int fd) { asked_.erase(fd); }); };
  look();
  zmq::message_t message;
  while (socket_.recv(message, zmq::recv_flags::dontwait)) {
    look();  // or what the one before had under this number would count
    if (message.size() == 0) continue;
    const int fd = zmq_msg_get(message.handle(), ZMQ_SRCFD);
    const std::uint8_t what = *message.data<std::uint8_t>();
    std::string text(message.data<char>() + 1, message.size() - 1);
    // What changes nothing would never end, and each choice of fields takes time of every cycle.
    if (what > 1 || (fd >= 0 && (what == 1 ? asked_[fd].size() >= kMostOfOne || !asked_[fd].insert(text).second
                                           : asked_[fd].erase(text) == 0))) {
      hang_up(fd, endpoint_);
      refuse(message.to_string());
      continue;
    }
    if (text.ends_with('\0')) text.pop_back();
    what == 1 ? subscribe(text, fd) : cancel(text);
  }
}

void Publisher::subscribe(const std::string& text, int fd) {
  if (const auto known = topics_.find(text); known != topics_.end()) {
    ++known->second.wanted;
  } else if (const auto unserved = unserved_.find(text); unserved != unserved_.end()) {
    ++unserved->second;
  } else if (auto topic = parse(text); topic && topics_.size() < kMostTopics) {
    topics_[text] = std::move(*topic);
  } else {
    unserved_[text] = 1;
    if (unserved_.size() > kMostUnserved) hang_up(fd, endpoint_);
    refuse(text);
  }
}

void Publisher::cancel(const std::string& text) {
  if (const auto known = topics_.find(text); known != topics_.end()) {
    if (--known->second.wanted == 0) topics_.erase(known);
  } else if (const auto unserved = unserved_.find(text); unserved != unserved_.end()) {
    if (--unserved->second == 0) unserved_.erase(unserved);
  }
}

// Tells of each power of two, so that whoever goes on does not fill the log.
void Publisher::refuse(const std::string& text) {
  if (std::has_single_bit(++refused_)) {
    spdlog::warn("nothing is published to a subscription of \"{:.80}\"; {} like that so far", text, refused_);
  }
}

// None for what is no such text.
std::optional<Publisher::Topic> Publisher::parse(const std::string& text) {
  Topic topic;
  const std::size_t space = std::min(text.find(' '), text.size());
  const auto [end, error] = std::from_chars(text.data(), text.data() + space, topic.every);
  if (error != std::errc() || end != text.data() + space || topic.every == 0 || text[0] == '0') return std::nullopt;
  if (space < text.size()) {
    auto& fields = topic.fields.emplace();
    google::protobuf::util::FieldMaskUtil::FromString(text.substr(space + 1), &fields);
    if (fields.paths().empty() || !google::protobuf::util::FieldMaskUtil::IsValidFieldMask<proto::ArmState>(fields)) {
      return std::nullopt;
    }
  }
  topic.prefix = text + '\0';
  return topic;
}

void Publisher::publish(const realtime::Record& record) {
  convert(record, message_);
  {
    const std::lock_guard lock(mutex_);
    add_rest(record, message_);
  }
  for (const auto& [text, topic] : topics_) {
    if (record.cycles % topic.every != 0) continue;
    bytes_ = topic.prefix;
    if (topic.fields) {
      part_.Clear();
      google::protobuf::util::FieldMaskUtil::MergeMessageTo(message_, *topic.fields, {}, &part_);
      part_.AppendToString(&bytes_);
    } else {
      message_.AppendToString(&bytes_);
    }
    socket_.send(zmq::buffer(bytes_), zmq::send_flags::dontwait);
  }
}

void Publisher::count_late(const realtime::Record& record) {
  const bool moves = record.phase == realtime::Phase::kRunning || record.phase == realtime::Phase::kHolding ||
                     record.phase == realtime::Phase::kBraking;
  if (moves && moved_) {
    motion_cycles_.fetch_add(1, std::memory_order_relaxed);
    if (record.received_ns - received_ns_ > kLateCycle) late_cycles_.fetch_add(1, std::memory_order_relaxed);
  }
  moved_ = moves;
  received_ns_ = record.received_ns;
}

void Publisher::describe(proto::ServerStatus& out) const {
  out.set_late_cycles(late_cycles_.load(std::memory_order_relaxed));
  out.set_motion_cycles(motion_cycles_.load(std::memory_order_relaxed));
}

// With mutex_ locked.
void Publisher::add_rest(const realtime::Record& record, proto::ArmState& state) const {
  const auto description = descriptions_.find(record.skill_id);
  if (description != descriptions_.end()) {
    state.set_skill_description(description->second.text);
    *state.mutable_skill_parts() = description->second.parts;
  } else {
    state.clear_skill_description();
    state.clear_skill_parts();
  }
  state.clear_gripper();
  if (gripper_ != nullptr) gripper_->put_state(state);
  if (not_taken_) {
    auto& out = *state.mutable_not_taken();
    out.set_wrong_size(not_taken_->wrong_size);
    out.set_bad_values(not_taken_->bad_values);
    out.set_old(not_taken_->old);
    out.set_foreign(not_taken_->foreign);
    out.set_unsent(not_taken_->unsent);
    out.set_unasked(not_taken_->unasked);
  }
  state.set_age((now_ns() - record.received_ns) * 1e-9);
}

std::optional<realtime::Record> Publisher::newest() const {
  realtime::Record record;
  while (const std::uint64_t written = ring_.written()) {
    if (ring_.read(written - 1, record)) return record;
  }
  return std::nullopt;
}

proto::ArmState Publisher::state(const realtime::Record& record) const {
  proto::ArmState state;
  convert(record, state);
  const std::lock_guard lock(mutex_);
  add_rest(record, state);
  return state;
}

void Publisher::count(std::shared_ptr<const robot::FciDriver::Counters> not_taken) {
  const std::lock_guard lock(mutex_);
  not_taken_ = std::move(not_taken);
}

void Publisher::describe(std::uint64_t id, const proto::Skill& skill) {
  Description description{skill.description(), {}};
  description.parts.set_trajectory(kind_of(skill.trajectory()));
  description.parts.set_controller(kind_of(skill.controller()));
  for (const auto& each : skill.terminations()) description.parts.add_terminations(kind_of(each));
  const std::lock_guard lock(mutex_);
  descriptions_[id] = std::move(description);
  if (descriptions_.size() > kDescriptionsKept) descriptions_.erase(descriptions_.begin());
}

}  // namespace server
