#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <zmq.hpp>

#include "frankapy/proto/service.pb.h"
#include "realtime/door.hpp"
#include "server/answers.hpp"
#include "server/client_jobs.hpp"
#include "server/clients.hpp"
#include "server/connected_arm.hpp"
#include "server/inbox.hpp"
#include "server/limit_store.hpp"
#include "server/recovery.hpp"
#include "server/skill_builder.hpp"
#include "server/skills.hpp"
#include "server/sockets.hpp"
#include "server/wakeful_clock.hpp"
#include "server/wall_store.hpp"
#include "server/workbench.hpp"

namespace server {

class Gripper;
class Publisher;
class Recorder;
class SensorHub;

// The arm's side of service.proto: a ROUTER which answers any number of clients, of which one at a time
// has the lease and may command. It is taken with the first command, and freed by Goodbye or when the
// client is silent for Options::lease_time; a skill of a client that is gone runs on, and the next commander's
// preempts it. Whatever arrives, it goes on: what cannot be read is counted, logged and, where it has a
// request_id, answered.
//
// Nothing slow stands in front of what is urgent: of all that has arrived StopSkill comes first, and what takes long (reading a
// large request, building a skill) is done on a workbench, one request of a client at a time.
class Transport {
 public:
  struct Options {
    std::chrono::milliseconds lease_time{800};  // of a client's silence, after which its lease is free
    std::function<std::chrono::steady_clock::duration()> clock = {};  // for that; none: a WakefulClock
    RecoveryConfig recovery = {};
  };

  // Binds to a port of `listen`: `port`, or a free one where that is 0 or taken. `gripper` may be null.
  Transport(zmq::context_t& context, const Listen& listen, std::uint16_t port, realtime::Door& door,
            Publisher& publisher, SensorHub& sensors, Recorder& recorder, Gripper* gripper,
            WallStore walls, Options options, LimitStore limits = LimitStore());
  Transport(zmq::context_t& context, const Listen& listen, std::uint16_t port, realtime::Door& door,
            Publisher& publisher, SensorHub& sensors, Recorder& recorder, Gripper* gripper,
            WallStore walls = WallStore({}), LimitStore limits = LimitStore());

  const std::string& endpoint() const { return endpoint_; }

  // Serves until `quit`; the thread goes before ordinary ones meanwhile (Preferred).
  void run(const std::atomic<bool>& quit);

  // From another thread: an arm is connected, and a loop is about to run at the door. `welcome` is what
  // clients are told of it, but for what this class knows. Returns when nothing is left of the last one.
  void connected(std::shared_ptr<SkillBuilder> builder, const frankapy::proto::Welcome& welcome) {
    arm_.connected(std::move(builder), welcome);
  }
  // There is none, for this reason; no loop runs at the door any more. Skills that it has not ended end
  // with kConnectionLost.
  void disconnected(const std::string& why) { arm_.disconnected(why); }

  // Rounds of run(); grows many times a second.
  std::uint64_t rounds() const { return rounds_.load(std::memory_order_relaxed); }
  // Messages that could not be read or were none of service.proto.
  std::uint64_t garbage() const { return inbox_.garbage(); }
  const Workbench& workbench() const { return jobs_.workbench(); }

 private:
  using Clock = std::chrono::steady_clock;

  void receive();
  void take(Arrived& arrived);
  void handle_waiting();
  void handle(const Arrived& arrived);
  void read_on_workbench(Arrived arrived);
  void answer(const Address& from, frankapy::proto::Request& request, std::uint64_t skill);
  void hello(const Address& from, const frankapy::proto::Request& request);
  void get_state(const Address& from);
  void list_topics(const Address& from);
  void get_server_status(const Address& from);
  void record(const Address& from, const frankapy::proto::Record& record);
  void record_for_those_there();
  void change_walls(const Address& from, const frankapy::proto::ChangeWalls& change);
  void tell_walls(const Address& from);
  void change_limits(const Address& from, const frankapy::proto::ChangeLimits& change);
  void start_gripper(const Address& from, const frankapy::proto::GripperCommand& command);
  void recover(const Address& from, const frankapy::proto::Recover& recover, std::uint64_t id);
  void goodbye(const Address& from);

  void take_gripper_results();
  void take_disconnection();
  void take_time(Clients::Client& client, const frankapy::proto::Request& request);

  realtime::Door& door_;
  Publisher& publisher_;
  SensorHub& sensors_;
  Recorder& recorder_;
  Gripper* gripper_;
  zmq::socket_t socket_;
  std::string endpoint_;
  ConnectionLimit connections_;
  const std::function<Clock::duration()> clock_;  // none: wakeful_clock_
  WakefulClock wakeful_clock_{std::chrono::milliseconds(100)};

  Answers answers_;
  Inbox inbox_;
  Clients clients_;
  ConnectedArm arm_;
  std::uint64_t last_ticket_ = 0;
  std::map<std::uint64_t, Address> gripping_;
  std::set<std::string> recording_for_;  // identities of clients
  std::atomic<std::uint64_t> rounds_{0};
  Recovery recovery_;
  Skills skills_;
  std::weak_ptr<void> keeping_;  // while walls that are to be kept are being written
  ClientJobs jobs_;  // goes first, as what is on the workbench uses the rest
};

}  // namespace server
