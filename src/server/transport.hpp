#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>
#include <zmq.hpp>

#include "frankapy/proto/service.pb.h"
#include "realtime/door.hpp"
#include "server/clock_estimate.hpp"
#include "server/limit_store.hpp"
#include "server/skill_builder.hpp"
#include "server/sockets.hpp"
#include "server/wall_store.hpp"
#include "server/wakeful_clock.hpp"
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
  };

  // Binds to a port of `listen`: `port`, or a free one where that is 0 or taken. `gripper` may be null.
  Transport(zmq::context_t& context, const std::string& listen, std::uint16_t port, realtime::Door& door,
            Publisher& publisher, SensorHub& sensors, Recorder& recorder, Gripper* gripper,
            WallStore walls, Options options, LimitStore limits = LimitStore());
  Transport(zmq::context_t& context, const std::string& listen, std::uint16_t port, realtime::Door& door,
            Publisher& publisher, SensorHub& sensors, Recorder& recorder, Gripper* gripper,
            WallStore walls = WallStore({}), LimitStore limits = LimitStore());
  ~Transport();

  const std::string& endpoint() const { return endpoint_; }

  // Serves until `quit`; the thread goes before ordinary ones meanwhile (Preferred).
  void run(const std::atomic<bool>& quit);

  // From another thread: an arm is connected, and a loop is about to run at the door. `welcome` is what
  // clients are told of it, but for what this class knows. Returns when nothing is left of the last one.
  void connected(std::shared_ptr<SkillBuilder> builder, const frankapy::proto::Welcome& welcome);
  // There is none, for this reason; no loop runs at the door any more. Skills that it has not ended end
  // with kConnectionLost.
  void disconnected(const std::string& why);

  // Rounds of run(); grows many times a second.
  std::uint64_t rounds() const { return rounds_.load(std::memory_order_relaxed); }
  // Messages that could not be read or were none of service.proto.
  std::uint64_t garbage() const { return garbage_.load(std::memory_order_relaxed); }
  const Workbench& workbench() const { return workbench_; }

 private:
  using Clock = std::chrono::steady_clock;

  struct Client {
    std::string name;
    Clock::duration last_heard;  // by clock_
    ClockEstimate clock = {};
  };
  struct Address {  // whom to answer
    std::string client;  // ROUTER's identity
    std::uint64_t request_id = 0;
  };
  struct Running {
    Address starter;
    std::vector<std::string> terminations;  // kinds
    realtime::Reference goal;               // of its trajectory
    frankapy::proto::Skill message;
    robot::Mode mode;
    robot::Settings settings;
  };
  struct Changing {
    Address from;
    std::uint64_t skill = 0;
    frankapy::proto::Skill message;  // what the skill then is
    realtime::Reference goal;
    std::vector<std::shared_ptr<realtime::SensorInput>> inputs;
  };
  // Arrived and not dealt with yet.
  struct Waiting {
    std::string client;
    zmq::message_t frame;
    std::uint64_t skill;  // the id of the skill that it may start: given on arrival, so that a Stop behind it stops it too
  };
  // The walls as a builder gets them.
  struct WallsForBuilder {
    realtime::Walls walls;
    WallStore names;
  };
  struct Connection {
    std::shared_ptr<SkillBuilder> builder;  // null: not connected; the workbench's to use
    std::shared_ptr<const WallsForBuilder> walls;
    models::Limits limits{};  // of what may be asked for
    frankapy::proto::Welcome welcome;
    std::string why_not = "the robot is being connected";
  };

  // A skill on the workbench, and what it is for.
  struct Build {
    Address from;
    frankapy::proto::Request request;  // without the skill
    Connection connection;
    frankapy::proto::Skill message;  // what the skill is, or will be
    std::uint64_t skill_id = 0;
    std::optional<realtime::Reference> after;  // the end of the one before, where that is queued behind
    bool path = true;
    std::unique_ptr<realtime::Skill> skill;
  };
  // What a skill to start finds before it.
  struct Before {
    bool queued = false;     // it waits for a skill that runs
    bool cancelled = false;  // the skill that it was to wait for did not end by itself
  };

  void receive();
  void take(zmq::message_t& identity, zmq::message_t& frame);
  void handle_waiting();
  void handle(const Waiting& waiting);
  void read_on_workbench(Waiting waiting);
  void put_on_workbench(const Address& from, std::function<void()> work, std::function<void()> done);
  void put_on_workbench(std::shared_ptr<Build> build, void (Transport::*go_on)(Build&));
  void answer(const Address& from, frankapy::proto::Request& request, std::uint64_t skill);
  void refuse(const Address& from, const std::exception_ptr& thrown);
  void hello(const Address& from, const frankapy::proto::Hello& hello);
  void get_state(const Address& from);
  void start_skill(const Address& from, frankapy::proto::Request& request, std::uint64_t id);
  Before before(const Address& from, const frankapy::proto::StartSkill& start) const;
  void begin_skill(Build& build);
  void change_skill(const Address& from, frankapy::proto::Request& request);
  frankapy::proto::Skill changed(const Address& from, const frankapy::proto::ChangeSkill& change) const;
  void begin_change(Build& build);
  void list_topics(const Address& from);
  void get_server_status(const Address& from);
  void record(const Address& from, const frankapy::proto::Record& record);
  void change_walls(const Address& from, const frankapy::proto::ChangeWalls& change);
  void change_limits(const Address& from, const frankapy::proto::ChangeLimits& change);
  void stop_skill(const Address& from);
  void skill_status(const Address& from, std::uint64_t id);
  void start_gripper(const Address& from, const frankapy::proto::GripperCommand& command);
  void recover(const Address& from);
  void goodbye(const Address& from);

  void hand_on_queued();
  void cancel_queue(realtime::Ending ending);
  void take_results();
  void end_skill(const realtime::SkillResult& result);
  void take_changes();
  void take_former_walls();
  void take_taken_bounds();
  void take_recoveries();
  void take_gripper_results();
  void take_disconnection();

  void note(frankapy::proto::SkillEvent& event, std::uint64_t skill, const Address& from);
  void take_time(Client& client, const frankapy::proto::Request& request);
  Client& known(const Address& from);
  void require_lease(const Address& from) const;
  realtime::Record require_state() const;
  void take_lease(const Address& from);
  void expire_lease();
  Connection require_connection() const;
  void hand_on_walls();
  void hand_on_limits();

  void send(const Address& to, frankapy::proto::Reply& reply);
  void send_error(const Address& to, frankapy::proto::Error::Code code, const std::string& message);
  void send_done(const Address& to);
  void count_garbage(const std::string& what);

  realtime::Door& door_;
  Publisher& publisher_;
  SensorHub& sensors_;
  Recorder& recorder_;
  Gripper* gripper_;
  zmq::socket_t socket_;
  std::string endpoint_;
  ConnectionLimit connections_;
  const Options options_;

  std::deque<Waiting> waiting_;
  std::size_t waiting_bytes_ = 0;
  std::unordered_map<std::string, Client> clients_;  // by identity
  std::string commander_;                            // identity; empty: the lease is free
  std::uint64_t last_skill_ = 0;
  std::map<std::uint64_t, Running> running_;  // by id; those that are queued as well
  std::deque<std::unique_ptr<realtime::Skill>> queue_;     // not at the door yet
  std::map<std::uint64_t, frankapy::proto::SkillResult> results_;  // the newest ones
  std::optional<Changing> changing_;
  std::vector<Address> recovering_;
  std::uint64_t last_ticket_ = 0;
  std::map<std::uint64_t, Address> gripping_;

  mutable std::mutex mutex_;
  Connection connection_;
  WallStore walls_;
  LimitStore limits_;
  bool disconnected_ = false;  // and not dealt with yet
  std::condition_variable settled_;

  std::atomic<std::uint64_t> rounds_{0}, garbage_{0};
  Clock::time_point garbage_told_{};
  WakefulClock clock_{std::chrono::milliseconds(100)};
  Clock::duration now_{};  // by it, in this round
  std::set<std::string> at_workbench_;  // identities of clients
  Workbench workbench_;                 // goes first, as its jobs use the rest
};

}  // namespace server
