#include "server/sensor_hub.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "server/clocks.hpp"
#include "server/refused.hpp"
#include "server/registry.hpp"
#include "server/roles.hpp"
#include "server/sensor_samples.hpp"
#include "wire/proto/validation.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;

constexpr std::int64_t kMaxSensorMessage = 1 << 16;  // bytes; a longer one ends its connection
constexpr int kReceiveQueue = 10'000;          // messages; a publisher of more has to wait
constexpr std::size_t kMaxTopics = 256;
constexpr std::size_t kMaxPublishers = 64;     // of one topic
constexpr std::size_t kMaxKinds = 64;          // of one topic
constexpr std::size_t kMaxTopicName = 256;     // bytes
constexpr std::size_t kMaxKind = 256;          // bytes, of its name
constexpr int kAtOnce = 256;                    // messages, and then it looks for what has ceased
constexpr auto kPollTime = std::chrono::milliseconds(50);
constexpr const char* kTermination = "ShouldTerminateSensorMessage";
constexpr std::int64_t kTellLostPeriod = 1'000'000'000;    // ns
constexpr std::int64_t kLate = 20'000'000, kStale = 500'000'000;  // ns: Topics.Topic

}  // namespace

SensorHub::SensorHub(zmq::context_t& context, const Listen& listen, std::uint16_t port, Journal& journal,
                     const std::atomic<std::uint64_t>& robot_time, bool lockstep)
    : journal_(journal), robot_time_(robot_time), lockstep_(lockstep), keys_(listen.keys),
      socket_(context, zmq::socket_type::pull) {
  socket_.set(zmq::sockopt::linger, 0);
  socket_.set(zmq::sockopt::rcvhwm, kReceiveQueue);
  socket_.set(zmq::sockopt::maxmsgsize, kMaxSensorMessage);
  endpoint_ = server::bind(socket_, listen, port);
  connections_.emplace(context, socket_);
  thread_ = std::thread([this] { run(); });
}

SensorHub::~SensorHub() {
  quit_ = true;
  thread_.join();
}

void SensorHub::check(const Publishers& publishers, const Inputs& inputs) const {
  for (const auto& each : publishers) {
    const auto listens = [&](const auto& input) { return input->topic() == each.topic(); };
    if (std::none_of(inputs.begin(), inputs.end(), listens)) {
      server::refuse(fmt::format("Skill.publishers has the topic \"{}\": expected one that a part of the skill listens to",
                                 each.topic()));
    }
    for (const std::string& name : each.names()) {
      if (keys_ != nullptr && keys_->knows_name(name)) continue;
      server::refuse(fmt::format("Skill.publishers has \"{}\" of the topic \"{}\": expected names of keys, and {}", name, each.topic(),
                                 keys_ == nullptr ? "this server has none" : "there is none of that name (`frankapy keys list`)"));
    }
  }
}

void SensorHub::bind(std::uint64_t skill, Inputs inputs, bool queued, const std::string& commander, const Publishers& publishers) {
  std::map<std::string, double> timeouts;  // of topics, s
  for (const auto& input : inputs) {
    if (input->timeout() <= 0) continue;
    const auto [least, is_new] = timeouts.emplace(input->topic(), input->timeout());
    if (!is_new) least->second = std::min(least->second, input->timeout());
  }
  const std::lock_guard lock(mutex_);
  for (auto& input : inputs) {
    const auto timeout = timeouts.find(input->topic());
    const double longest = timeout == timeouts.end() ? 0 : timeout->second;
    Listener listener{skill, std::move(input), std::llround(1e9 * longest), queued, {}};
    for (const auto& each : publishers) {
      if (each.topic() != listener.input->topic()) continue;
      if (!listener.publishers) listener.publishers.emplace();
      listener.publishers->insert(each.names().begin(), each.names().end());
    }
    if (keys_ != nullptr && !listener.publishers) listener.publishers = {commander};
    listeners_.push_back(std::move(listener));
  }
}

void SensorHub::release(std::uint64_t skill) {
  const std::lock_guard lock(mutex_);
  std::erase_if(listeners_, [&](const Listener& listener) {
    if (listener.skill != skill) return false;
    count_outdated(listener);
    return true;
  });
}

void SensorHub::release(std::uint64_t skill, const Inputs& inputs) {
  const std::lock_guard lock(mutex_);
  std::erase_if(listeners_, [&](const Listener& listener) {
    if (listener.skill != skill || std::find(inputs.begin(), inputs.end(), listener.input) == inputs.end()) return false;
    count_outdated(listener);
    return true;
  });
}

void SensorHub::describe(proto::Topics& out) const {
  out.set_garbage(garbage());
  const std::lock_guard lock(mutex_);
  std::map<std::string, proto::Topics::Topic> all;
  for (const auto& [name, topic] : topics_) {
    all[name] = topic.told;
    all[name].set_age(1e-9 * static_cast<double>(now_ns() - topic.arrived_ns));
  }
  for (const Listener& listener : listeners_) {
    auto& told = all[listener.input->topic()];
    const auto& skills = told.skills();
    if (std::find(skills.begin(), skills.end(), listener.skill) == skills.end()) told.add_skills(listener.skill);
    told.set_stale(told.stale() + listener.input->outdated());
  }
  for (auto& [name, told] : all) {
    told.set_topic(name);
    *out.add_topics() = std::move(told);
  }
}

void SensorHub::run() {
  while (!quit_) {
    zmq::pollitem_t item{socket_.handle(), 0, ZMQ_POLLIN, 0};
    zmq::poll(&item, 1, kPollTime);
    connections_->look();
    look_for_silence();
    zmq::message_t frame;
    for (int n = 0; n < kAtOnce && !quit_ && socket_.recv(frame, zmq::recv_flags::dontwait); ++n) {
      if (frame.more()) {
        while (frame.more() && socket_.recv(frame)) {
        }
        count_garbage("a message of several frames (expected one)");
        continue;
      }
      take(frame);
    }
  }
}

void SensorHub::take(const zmq::message_t& frame) {
  proto::SensorMessage message;
  if (!message.ParseFromArray(frame.data(), static_cast<int>(frame.size()))) {
    return count_garbage(fmt::format("{} bytes that are no SensorMessage", frame.size()));
  }
  try {
    wire::validate(message);
  } catch (const wire::Invalid& invalid) {
    return count_garbage(invalid.what());
  }
  if (message.topic().empty() || message.topic().size() > kMaxTopicName) {
    return count_garbage(fmt::format("a topic of {} bytes (expected 1 to {})", message.topic().size(), kMaxTopicName));
  }
  if (message.message().type_url().size() > kMaxKind) {
    return count_garbage(fmt::format("a kind of {} bytes (expected at most {})", message.message().type_url().size(), kMaxKind));
  }
  const Keys::Client who = sender_of(frame, keys_);
  const std::lock_guard lock(mutex_);
  if (who.role < proto::USER) {
    const std::string why = explain_role(who, "to publish sensor messages", proto::USER);
    const auto known = topics_.find(message.topic());
    return known == topics_.end() ? count_garbage("a sensor message: " + why) : refuse(known->second, why);
  }
  if (topics_.size() >= kMaxTopics && !topics_.contains(message.topic())) forget_quietest_topic();
  Topic& topic = topics_[message.topic()];
  topic.told.set_received(topic.told.received() + 1);
  topic.told.set_message(kind_of(message.message()));
  const std::int64_t now = now_ns();
  if (topic.arrived_ns != 0) {
    const double period = 1e-9 * static_cast<double>(now - topic.arrived_ns);
    topic.told.set_period(topic.told.has_period() ? 0.9 * topic.told.period() + 0.1 * period : period);
  }
  topic.arrived_ns = now;

  if (message.has_sent_ns() && !ClockEstimate::is_time(message.sent_ns())) {
    return refuse(topic, fmt::format("its sent_ns is {}: expected ns since 1970", message.sent_ns()));
  }
  if (topic.publishers.size() >= kMaxPublishers) topic.publishers.clear();
  auto [publisher, is_new] = topic.publishers.try_emplace({who.key, message.publisher()});
  Publisher& from = publisher->second;
  const bool behind = message.has_sequence() && message.sequence() <= from.sequence;
  ClockEstimate::Way way;
  if (message.has_sent_ns() && !behind) way = from.clock.take(message.sent_ns(), since_epoch_ns(now), message.way_ns());
  note(message, from, now);
  const bool ends = topic.told.message() == kTermination;  // an end is an end at any time
  if (behind) {
    topic.told.set_out_of_order(topic.told.out_of_order() + 1);
    if (!ends) return;
  }
  if (message.has_sequence() && !behind) {
    if (!is_new) topic.told.set_lost(topic.told.lost() + message.sequence() - from.sequence - 1);
    from.sequence = message.sequence();
  }
  if (way.in_future > 0 && !ends) {
    return refuse(topic, fmt::format("its time stamp is {:.3f} s in the future of those before",
                                     1e-9 * static_cast<double>(way.in_future)));
  }
  deliver(topic, message, message.sent_ns() - from.clock.ahead_ns(), ends ? 0 : way.longer, who);
}

// Of those that nobody listens to, as far as there is one.
void SensorHub::forget_quietest_topic() {
  const auto rank = [this](const std::string& name, const Topic& topic) {
    const bool heard = std::any_of(listeners_.begin(), listeners_.end(),
                                   [&](const Listener& each) { return each.input->topic() == name; });
    return std::pair(heard, topic.arrived_ns);
  };
  topics_.erase(std::min_element(topics_.begin(), topics_.end(), [&](const auto& a, const auto& b) {
    return rank(a.first, a.second) < rank(b.first, b.second);
  }));
}

// Of topics over which something came.
void SensorHub::look_for_silence() {
  const std::uint64_t now = robot_time_.load(std::memory_order_relaxed);
  const std::lock_guard lock(mutex_);
  for (Listener& listener : listeners_) {
    const auto found = topics_.find(listener.input->topic());
    if (found == topics_.end() || listener.longest_ns == 0 || listener.input->begun() == 0) continue;
    const std::uint64_t since = std::max(listener.covered, listener.input->begun());
    if (listener.silent || now < since || 1'000'000 * static_cast<std::int64_t>(now - since) <= listener.longest_ns) continue;
    for (Listener& each : listeners_) {  // parts of one skill
      each.silent |= each.skill == listener.skill && each.input->topic() == listener.input->topic();
    }
    auto& told = found->second.told;
    told.set_silences(told.silences() + 1);
    spdlog::warn("{}: nothing has come for {:.3f} s, the timeout of the part of skill {} that listens", found->first,
                 1e-9 * static_cast<double>(listener.longest_ns), listener.skill);
  }
}

bool SensorHub::takes(const Listener& listener, const std::string& publisher) {
  return !listener.publishers || listener.publishers->contains(publisher);
}

// Whether a newer message of this kind came before, from another publisher that the listener takes. What is not late is not
// asked: clocks are known no better.
bool SensorHub::overtaken(const Topic& topic, const Listener& listener, const std::string& kind, std::int64_t sent,
                          std::int64_t longer) {
  const auto newest = topic.newest_ns.find(kind);
  return longer > kLate && newest != topic.newest_ns.end() &&
         std::any_of(newest->second.begin(), newest->second.end(),
                     [&](const auto& of) { return takes(listener, of.first) && sent + kLate < of.second; });
}

// With its time by our clock, and now and then what makes the difference.
void SensorHub::note(const proto::SensorMessage& message, Publisher& from, std::int64_t now) {
  const std::string_view type = message.message().type_url();
  const std::int64_t sent = message.has_sent_ns() ? message.sent_ns() - from.clock.ahead_ns() : 0;
  journal_.note("/sensors/" + message.topic(), type.substr(type.rfind('/') + 1), message.message().value(),
                static_cast<std::uint32_t>(message.sequence()), sent);
  if (!from.clock.is_due(since_epoch_ns(now))) return;
  proto::ClockDifference difference;
  difference.set_sender(message.topic());
  difference.set_publisher(message.publisher());
  from.clock.put(difference);
  journal_.note("/clocks", difference.GetTypeName(), difference.SerializeAsString());
}

// `sent`: when, by our clock, ns; `longer`: than the quickest of its publisher it took, ns.
void SensorHub::deliver(Topic& topic, const proto::SensorMessage& message, std::int64_t sent, std::int64_t longer,
                        const Keys::Client& from) {
  const std::string kind = kind_of(message.message());
  const std::uint64_t came = robot_time_.load(std::memory_order_relaxed);
  std::vector<realtime::SensorSample> samples;
  bool heard = false, taken = false, dropped = false, behind = false;
  const auto listens = [&](const Listener& listener) { return listener.input->topic() == message.topic() && !waits(listener); };
  // What some part wants of a kind is nothing for those that take any: they would be kept content by what nobody can use.
  bool of_kinds = false, wanted = false;
  for (const Listener& listener : listeners_) {
    if (!listens(listener) || !takes(listener, from.name)) continue;
    const auto& messages = listener.input->messages();
    of_kinds |= !messages.empty();
    wanted |= std::find(messages.begin(), messages.end(), kind) != messages.end();
  }
  std::string expected, publishers;
  try {
    for (Listener& listener : listeners_) {
      realtime::SensorInput& input = *listener.input;
      if (!listens(listener)) continue;
      heard = true;
      if (!takes(listener, from.name)) {
        publishers = fmt::format("{}", fmt::join(*listener.publishers, ", "));
        continue;
      }
      const auto& messages = input.messages();
      const auto found = std::find(messages.begin(), messages.end(), kind);
      if (found == messages.end() && !messages.empty()) {
        expected += (expected.empty() ? "" : ", ") + fmt::format("{}", fmt::join(messages, ", "));
        continue;
      }
      if (of_kinds && !wanted) continue;
      taken = true;
      if (overtaken(topic, listener, kind, sent, longer)) {
        behind = true;
        continue;
      }
      if (samples.empty()) samples = samples_of(message.message());
      for (auto& sample : samples) {
        sample.came = came;
        sample.message = messages.empty() ? 0 : static_cast<int>(found - messages.begin());
        sample.sent_ns = lockstep_ ? 0 : message.sent_ns();
        if (const std::string why = input.check(sample); !why.empty()) throw wire::Invalid(kind + ": " + why);
      }
      bool replaces = false;
      for (realtime::SensorSample sample : samples) {
        replaces |= sample.replaces;
        if (listener.longest_ns > 0 && longer - std::llround(1e9 * sample.lead) > listener.longest_ns) {
          dropped = true;
          continue;
        }
        sample.replaces = std::exchange(replaces, false);
        listener.silent = false;
        listener.covered = came + static_cast<std::uint64_t>(1e3 * sample.lead);
        if (!input.put(sample)) topic.told.set_overrun(topic.told.overrun() + 1);
      }
    }
    if (!heard) samples_of(message.message());  // so that what is wrong is found before a skill listens
  } catch (const wire::Invalid& invalid) {
    return refuse(topic, invalid.what());
  }
  if (heard && !taken) {
    refuse(topic, !expected.empty() ? fmt::format("it is {}: expected {}", kind, expected)
                                    : fmt::format("it is of the key \"{}\": the skill that listens takes {} (its `publishers`)",
                                                  from.name, publishers));
  }
  if (topic.newest_ns.size() >= kMaxKinds) topic.newest_ns.clear();
  std::int64_t& newest = topic.newest_ns[kind][from.name];
  newest = std::max(newest, sent);
  if (behind) {
    topic.told.set_out_of_order(topic.told.out_of_order() + 1);
    return;
  }
  count_late(topic, message, longer, dropped);
}

void SensorHub::count_late(Topic& topic, const proto::SensorMessage& message, std::int64_t longer, bool dropped) {
  if (dropped || longer > kStale) {
    topic.told.set_stale(topic.told.stale() + 1);
  } else if (longer > kLate) {
    topic.told.set_late(topic.told.late() + 1);
  }
  if (dropped && !topic.stale) {
    spdlog::warn("{}: a message took {:.3f} s longer than the quickest of its publisher, more than the timeout of the part that "
                 "listens: it moves nothing",
                 message.topic(), 1e-9 * static_cast<double>(longer));
  }
  topic.stale = dropped;
}

// What it would not take as it began.
void SensorHub::count_outdated(const Listener& listener) {
  const auto topic = topics_.find(listener.input->topic());
  if (topic != topics_.end()) topic->second.told.set_stale(topic->second.told.stale() + listener.input->outdated());
}

// Until the skills before its own have ended.
bool SensorHub::waits(const Listener& listener) const {
  return listener.queued && std::any_of(listeners_.begin(), listeners_.end(), [&](const Listener& other) {
           return other.skill < listener.skill && other.input->topic() == listener.input->topic();
         });
}

void SensorHub::refuse(Topic& topic, const std::string& why) {
  topic.told.set_refused(topic.told.refused() + 1);
  // A stream of them may say something else each time.
  if (const std::int64_t now = now_ns(); topic.told.why_refused() != why && now - topic.refusal_told_ns > kTellLostPeriod) {
    topic.refusal_told_ns = now;
    spdlog::warn("a sensor message was refused: {}", why);
  }
  topic.told.set_why_refused(why);
}

void SensorHub::count_garbage(const std::string& what) {
  const auto count = garbage_.fetch_add(1) + 1;
  if (const std::int64_t now = now_ns(); now - told_ns_ > kTellLostPeriod) {
    told_ns_ = now;
    spdlog::warn("dropped {}; {} sensor messages like that so far", what, count);
  }
}

}  // namespace server
