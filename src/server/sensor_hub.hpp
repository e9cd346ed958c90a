#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>
#include <zmq.hpp>

#include "frankapy/proto/sensors.pb.h"
#include "frankapy/proto/service.pb.h"
#include "realtime/sensor_input.hpp"
#include "server/clock_estimate.hpp"
#include "server/journal.hpp"
#include "server/sockets.hpp"

namespace server {

// Takes SensorMessages from any number of publishers and puts them into the parts of skills that listen to their topics. What
// cannot be read, is of another kind, carries numbers that are not finite or against the message's rules or the part's own check,
// comes behind a newer one or too late for it, or is of somebody whom the skill or its role does not let, is counted with its topic
// and dropped; but not what ends a skill, which does so at any time.
class SensorHub {
 public:
  // Binds to a port of `listen`: `port`, or a free one where that is 0 or taken. `robot_time`: ms. `lockstep`: the arm's time is
  // not that of any clock, so that parts are not told when messages were sent.
  SensorHub(zmq::context_t& context, const Listen& listen, std::uint16_t port, Journal& journal,
            const std::atomic<std::uint64_t>& robot_time, bool lockstep);
  ~SensorHub();

  const std::string& endpoint() const { return endpoint_; }

  using Publishers = google::protobuf::RepeatedPtrField<frankapy::proto::Publishers>;
  using Inputs = std::vector<std::shared_ptr<realtime::SensorInput>>;

  // Throws Refused for publishers that there are not, or of a topic that none of these inputs has.
  void check(const Publishers& publishers, const Inputs& inputs) const;
  // From now on, until release(), messages of these publishers get into these inputs of a skill, and over topics that they do not
  // have those of its commander's key; without keys everybody's. Into those of one that is queued only while no skill before it
  // listens to their topic. The least timeout of these inputs is that of all that share its topic: what took longer than that on
  // its way, beside the quickest of its publisher, tells them nothing any more.
  void bind(std::uint64_t skill, Inputs inputs, bool queued, const std::string& commander = "", const Publishers& publishers = {});
  void release(std::uint64_t skill);
  void release(std::uint64_t skill, const Inputs& inputs);

  // What came over each topic so far.
  void describe(frankapy::proto::Topics& out) const;

  // Messages that could not be read.
  std::uint64_t garbage() const { return garbage_.load(std::memory_order_relaxed); }

 private:
  struct Listener {
    std::uint64_t skill;
    std::shared_ptr<realtime::SensorInput> input;
    std::int64_t longest_ns;  // that a message may take; 0: any time
    bool queued;
    std::optional<std::set<std::string>> publishers;  // names of keys; absent: there are no keys
    std::uint64_t covered = 0;  // ms of the robot's time, until which what came last says what to do
    bool silent = false;        // for longer after that than the timeout
  };
  struct Publisher {
    std::uint64_t sequence = 0;
    ClockEstimate clock;
  };
  struct Topic {
    frankapy::proto::Topics::Topic told;
    std::int64_t arrived_ns = 0;  // CLOCK_MONOTONIC, of the newest
    std::int64_t refusal_told_ns = 0;  // likewise, when one was last told of
    std::map<std::pair<std::string, std::uint64_t>, Publisher> publishers;  // by key, and number of their own
    // Of each kind and each publisher's key: when the newest was sent, by our clock.
    std::map<std::string, std::map<std::string, std::int64_t>> newest_ns;
    bool stale = false;  // the newest was
  };

  void run();
  void take(const zmq::message_t& frame);
  void note(const frankapy::proto::SensorMessage& message, Publisher& from, std::int64_t now);
  void forget_quietest_topic();
  void look_for_silence();
  static bool takes(const Listener& listener, const std::string& publisher);
  static bool overtaken(const Topic& topic, const Listener& listener, const std::string& kind, std::int64_t sent,
                        std::int64_t longer);
  void deliver(Topic& topic, const frankapy::proto::SensorMessage& message, std::int64_t sent, std::int64_t longer,
               const Keys::Client& from);
  void count_late(Topic& topic, const frankapy::proto::SensorMessage& message, std::int64_t longer, bool dropped);
  void count_outdated(const Listener& listener);
  bool waits(const Listener& listener) const;
  void refuse(Topic& topic, const std::string& why);
  void count_garbage(const std::string& what);

  Journal& journal_;  // gets every message that can be read, also those that are then dropped
  const std::atomic<std::uint64_t>& robot_time_;
  const bool lockstep_;
  const Keys* keys_;   // null: there are none
  zmq::socket_t socket_;
  std::string endpoint_;
  std::optional<ConnectionLimit> connections_;

  mutable std::mutex mutex_;
  std::vector<Listener> listeners_;
  std::map<std::string, Topic> topics_;

  std::atomic<std::uint64_t> garbage_{0};
  std::int64_t told_ns_ = 0;
  std::atomic<bool> quit_{false};
  std::thread thread_;
};

}  // namespace server
