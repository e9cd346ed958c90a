#pragma once

#include <csignal>
#include <map>
#include <memory>

#include "sim/door/gripper_server.hpp"
#include "sim/door/mailbox.hpp"
#include "sim/door/robot_server.hpp"
#include "sim/pace.hpp"
#include "sim/world/truth_file.hpp"

namespace sim {

// One world with one or several arms in it, its time, and the loop that runs them; a thread of its own, or the one of
// whoever asks for its cycles.
class Cell {
 public:
  struct Arm {
    const models::Arm* model;
    in_addr address;
    std::string truth;      // file; empty: none
    std::string wire = {};  // likewise
  };
  enum class Time { kRuns, kBetweenMotionsPaused, kPaused };
  struct Options {
    std::vector<Arm> arms = {};
    std::string scene = {};
    std::optional<fci::Version> version = {};  // the only one to speak; empty: any that systems of the arm spoke
    bool lockstep = false;
    bool ideal = false;
    double speed = 1;
    std::uint64_t seed = 1;  // of the first arm; the next have the next
    Time time = Time::kRuns;
    // ns for which a cycle in lockstep waits for its command, which then is lost; nearly three times that where time
    // stands still between motions. Twenty of them end a motion, and a client which waits for a state for a second must
    // not give up meanwhile.
    std::int64_t patience = 250'000'000;
  };

  // Its time is the clock's, which must outlive it. Throws std::runtime_error which says what is wrong with a scene, an
  // address or a file.
  Cell(const Options& options, Clock& clock);

  // Until `stopped`. Throws std::runtime_error when the disk takes no more truth.
  void run(const volatile std::sig_atomic_t& stopped);
  // One, which begins when the clock says so or its commands are there.
  void run_cycle();
  // Nothing is done any more that is asked for.
  void close() { mailbox_.close(); }

  // --- from any thread ----------------------------------------------------------------------------------------

  // Has it done between two cycles, and waits for it; see Mailbox.
  template <class Task>
  void ask(Task&& task) {
    mailbox_.ask(std::forward<Task>(task));
  }

  // --- within ask() -------------------------------------------------------------------------------------------

  World& world() { return world_; }
  Robot& robot(std::size_t arm) { return stations_[arm]->robot; }
  Network& network(std::size_t arm) { return stations_[arm]->robot_server.network(); }
  const Pace& pace() const { return pace_; }
  // Of the world's life, counted as message_id is: 1 is the state before the first.
  std::uint64_t cycle() const { return cycle_; }

  Time time() const { return time_; }
  void set_time(Time time);
  // While paused: lets so many cycles go by; steps_left() tells when they have. Throws std::runtime_error when time runs.
  void step(std::uint64_t cycles);
  std::uint64_t steps_left() const { return steps_; }

  // Moments: world, robots, hands and networks, kept under a number. Nothing has changed when these throw
  // std::runtime_error, which says what is in the way: as many as are kept are there already, there is no such moment, or
  // one of other objects, or what RobotServer says.
  static constexpr std::size_t kMostMoments = 100;
  std::uint64_t save();
  void restore(std::uint64_t moment);
  void forget(std::uint64_t moment);

 private:
  // An arm at its address.
  struct Station {
    Station(const Options& options, std::size_t index, const std::array<double, 2>& finger, Poller& poller);

    Robot robot;
    Gripper gripper;
    RobotServer robot_server;
    GripperServer gripper_server;
    std::optional<TruthFile> truth;
    const fci::RobotCommand* command = nullptr;  // of this cycle
    bool waits = false;  // in it: a motion that is paused has its client wait as well
  };
  struct Moment {
    std::shared_ptr<const World::Moment> world;
    std::vector<std::pair<RobotServer::Moment, GripperServer::Moment>> arms;
  };

  void receive_commands();
  void take_commands();
  void wait_for_commands(std::int64_t patience);
  void keep_pace();
  void serve();
  bool awaited(const Station& station) const;
  bool awaited() const;
  bool goes_on() const;
  const Moment& moment(std::uint64_t number) const;

  const bool lockstep_;
  const std::int64_t patience_;
  Clock& clock_;
  Poller poller_;
  World world_;
  std::vector<std::unique_ptr<Station>> stations_;
  std::vector<Drive> drives_;
  Pace pace_;
  Mailbox mailbox_;
  const volatile std::sig_atomic_t* stopped_;
  std::uint64_t cycle_;
  Time time_;
  std::uint64_t steps_ = 0;
  std::map<std::uint64_t, Moment> moments_;
  std::uint64_t last_moment_ = 0;
};

}  // namespace sim
