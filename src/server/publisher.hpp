#pragma once

#include <google/protobuf/field_mask.pb.h>

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <zmq.hpp>

#include "frankapy/proto/service.pb.h"
#include "frankapy/proto/state.pb.h"
#include "realtime/door.hpp"
#include "robot/fci_driver.hpp"
#include "server/sockets.hpp"

namespace server {

class Gripper;

// Takes the loop's records, publishes them as ArmState to those who listen, and has the newest for reads. A slow subscriber
// loses states; nobody waits for it.
//
// What is subscribed to says which states: "1" all, "10" one in ten, "10 robot.q,robot.dq,phase" these fields of it. A message is
// that text, a zero byte, and the ArmState. Subscriptions are bounded: who has one too many for the server, or one that is longer
// than any that makes sense, loses the connection; so does who subscribes twice to the same, or cancels what it has not.
class Publisher {
 public:
  // Binds to a port of `listen`: `port`, or a free one where that is 0 or taken. `gripper` may be null.
  Publisher(zmq::context_t& context, const Listen& listen, std::uint16_t port, realtime::Door& door,
            Gripper* gripper);
  ~Publisher();

  const std::string& endpoint() const { return endpoint_; }

  // The loop's newest record, whether it has been published or not; none before the first.
  std::optional<realtime::Record> newest() const;
  // A record as clients see it, with its age.
  frankapy::proto::ArmState state(const realtime::Record& record) const;

  // What of the robot that is connected now was not taken.
  void count(std::shared_ptr<const robot::FciDriver::Counters> not_taken);

  // How many cycles of motions there were, and how many of them late.
  void describe(frankapy::proto::ServerStatus& out) const;

  // What skill `id` is, for the states.
  void describe(std::uint64_t id, const frankapy::proto::Skill& skill);

 private:
  // What somebody listens to.
  struct Topic {
    std::string prefix;
    std::uint64_t every = 1;
    std::optional<google::protobuf::FieldMask> fields;
    int wanted = 1;  // by so many subscriptions, with the zero byte or without it
  };

  void run();
  void take_subscriptions();
  void subscribe(const std::string& text, int fd);
  void cancel(const std::string& text);
  void refuse(const std::string& text);
  static std::optional<Topic> parse(const std::string& text);
  void publish(const realtime::Record& record);
  void count_late(const realtime::Record& record);
  void add_rest(const realtime::Record& record, frankapy::proto::ArmState& state) const;

  const bridge::Ring<realtime::Record>& ring_;
  bridge::RingReader<realtime::Record> records_;
  Gripper* gripper_;
  zmq::socket_t socket_;
  std::string endpoint_;
  std::optional<ConnectionLimit> connections_;
  std::map<std::string, Topic> topics_;
  std::map<std::string, int> unserved_;         // what nothing is published to, and how many subscriptions to it there are
  std::map<int, std::set<std::string>> asked_;  // subscriptions of each connection, by its file descriptor
  std::uint64_t refused_ = 0;
  std::int64_t received_ns_ = 0;     // of the last record
  bool moved_ = false;               // in it
  std::atomic<std::uint64_t> late_cycles_{0}, motion_cycles_{0};
  frankapy::proto::ArmState message_, part_;
  std::string bytes_;

  mutable std::mutex mutex_;
  std::shared_ptr<const robot::FciDriver::Counters> not_taken_;
  struct Description {
    std::string text;
    frankapy::proto::SkillParts parts;
  };
  std::map<std::uint64_t, Description> descriptions_;

  std::atomic<bool> quit_{false};
  std::thread thread_;
};

}  // namespace server
