#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "frankapy/proto/service.pb.h"
#include "realtime/door.hpp"
#include "server/answers.hpp"
#include "server/client_jobs.hpp"
#include "server/clients.hpp"
#include "server/connected_arm.hpp"
#include "server/sensor_hub.hpp"
#include "server/skill_builder.hpp"

namespace server {

class Publisher;
class Recorder;
class Recovery;

// The skills of an arm from request to result: built on the workbench, queued, handed through the door, changed, ended; and what
// their clients are told of that.
class Skills {
 public:
  Skills(realtime::Door& door, Publisher& publisher, SensorHub& sensors, Recorder& recorder, ConnectedArm& arm, Clients& clients,
         Answers& answers, ClientJobs& jobs, Recovery& recovery);
  ~Skills();

  // For a request that may start one: ids grow in the order of arrival, so that a Stop stops all that came before it.
  std::uint64_t next_id() { return ++last_skill_; }

  // Requests of clients; each is answered, or throws Refused.
  void start(const Address& from, frankapy::proto::Request& request, std::uint64_t id);
  void change(const Address& from, frankapy::proto::Request& request);
  void check(const Address& from, frankapy::proto::Request& request);
  void stop(const Address& from);
  void tell_status(const Address& from, std::uint64_t id);

  // The server's own: the arm goes slowly to these joints (rad), which are near. `done` is told why it has not got there, and
  // nothing where it has.
  void move_back(const realtime::Vector7& q, std::function<void(const std::string&)> done);

  // The client that commands the arm has fallen silent; this file has what was before.
  void client_is_gone(const std::string& black_box);

  // Whether something of the loop is waited for.
  bool busy() const { return !running_.empty() || changing_; }
  bool any_run() const { return !running_.empty(); }
  // What has come from the loop, and what goes there next.
  void take_results();
  void take_changes();
  void hand_on_queued();
  // The loop is gone: what is still at the door or waited for will not be answered by it.
  void abandon(const std::string& why);

  // The loop's newest state. Throws Refused where there is none yet.
  realtime::Record require_state() const;

 private:
  // What the parts of a skill listen to; of those that a change brings.
  struct Listening {
    std::optional<SensorHub::Inputs> trajectory, controller, terminations;
    SensorHub::Inputs all() const;
  };
  static Listening listening_of(const realtime::Skill& skill);
  struct Running {
    Address starter;
    realtime::Reference goal;               // of its trajectory
    frankapy::proto::Skill message;
    robot::Mode mode;
    robot::Settings settings;
    bool lets_go;  // its controller
    MadeAt made_at;
    Listening listening;
    bool queued = false;  // behind another of its client
    std::function<void(const std::string&)> done = nullptr;  // of the server's own
    std::string black_box = {};                               // once its client is gone
    bool client_is_gone = false;
  };
  struct Changing {
    Address from;
    std::uint64_t skill = 0;
    frankapy::proto::Skill message;  // what the skill then is
    realtime::Reference goal;
    bool lets_go;
    MadeAt made_at;
    Listening listening;
  };

  // A skill on the workbench, and what it is for.
  struct Build {
    Address from;
    frankapy::proto::Request request;  // without the skill
    ConnectedArm::Connection connection;
    frankapy::proto::Skill message;  // what the skill is, or will be
    std::uint64_t skill_id = 0;
    Before before;  // where a checked one begins, too
    MadeAt made_at;
    std::unique_ptr<realtime::Skill> skill;
  };
  // What a skill to start finds.
  struct Found {
    bool queued = false;     // it waits for a skill that runs
    bool cancelled = false;  // the skill that it was to wait for did not end by itself
  };

  Found find(const Address& from, const frankapy::proto::StartSkill& start) const;
  void put_what_runs(Before& before) const;
  void begin(Build& build);
  frankapy::proto::Skill changed(const Address& from, const frankapy::proto::ChangeSkill& change) const;
  void begin_change(Build& build);
  void tell_checked(Build& build);
  void make(Build& build);
  void put_on_workbench(std::shared_ptr<Build> build, void (Skills::*go_on)(Build&));
  void cancel_queue(realtime::Ending ending);
  void end(const realtime::SkillResult& result);
  void begin_own(Build& build, std::function<void(const std::string&)> done);
  void tell(std::uint64_t id, frankapy::proto::Reply& reply);
  void note(frankapy::proto::SkillEvent& event, std::uint64_t skill, const Address& from);

  realtime::Door& door_;
  Publisher& publisher_;
  SensorHub& sensors_;
  Recorder& recorder_;
  ConnectedArm& arm_;
  Clients& clients_;
  Answers& answers_;
  ClientJobs& jobs_;
  Recovery& recovery_;

  std::uint64_t last_skill_ = 0;
  std::map<std::uint64_t, Running> running_;  // by id; those that are queued as well
  std::deque<std::unique_ptr<realtime::Skill>> queue_;     // not at the door yet
  std::map<std::uint64_t, frankapy::proto::SkillResult> results_;  // the newest ones
  std::optional<Changing> changing_;
};

}  // namespace server
