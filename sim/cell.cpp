#include "sim/cell.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace sim {
namespace {

// Where runs are to be the same, nothing but a client that is gone may cost a cycle: so many tenths of the patience.
constexpr std::int64_t kLonger = 28;

const volatile std::sig_atomic_t kNever = 0;

World::Options world_options(const Cell::Options& options) {
  World::Options world;
  world.arm = options.arms.front().model;
  for (std::size_t i = 1; i < options.arms.size(); ++i) world.more_arms.push_back(options.arms[i].model);
  world.scene = options.scene;
  world.ideal = options.ideal;
  return world;
}

}  // namespace

Cell::Station::Station(const Options& options, std::size_t index, const std::array<double, 2>& finger, Poller& poller)
    : robot(*options.arms[index].model, options.ideal, options.seed + index),
      gripper(finger),
      robot_server(*options.arms[index].model, options.arms[index].address, options.version,
                   options.arms[index].wire, robot, poller),
      gripper_server(options.arms[index].address, gripper, poller) {}

Cell::Cell(const Options& options, Clock& clock)
    : lockstep_(options.lockstep),
      patience_(options.patience),
      clock_(clock),
      poller_(clock),
      world_(world_options(options)),
      pace_(clock, options.lockstep ? 1 : options.speed),
      stopped_(&kNever),
      time_(options.time) {
  for (std::size_t i = 0; i < options.arms.size(); ++i) {
    Station& station = *stations_.emplace_back(std::make_unique<Station>(options, i, world_.truth(i).finger, poller_));
    if (!options.arms[i].truth.empty()) station.truth.emplace(options.arms[i].truth, world_);
    station.robot.sense(world_.truth(i));
  }
  drives_.resize(stations_.size());
  cycle_ = stations_.front()->robot.state().message_id;
}

void Cell::run(const volatile std::sig_atomic_t& stopped) {
  stopped_ = &stopped;
  pace_.restart();
  while (!stopped) run_cycle();
  if (pace_.late() > 0) {
    spdlog::info("{} cycles of {} were late by this computer's fault, the worst by {:.1f} ms", pace_.late(),
                 stations_.front()->robot.state().message_id, 1e3 * pace_.worst_delay());
  }
}

// --- the cycle ------------------------------------------------------------------------------------------------

void Cell::run_cycle() {
  receive_commands();
  const bool goes_on = this->goes_on();
  if (goes_on) {
    for (std::size_t i = 0; i < stations_.size(); ++i) {
      Station& station = *stations_[i];
      drives_[i] = {station.robot.control(std::exchange(station.command, nullptr)), station.gripper.control(world_.truth(i).finger)};
    }
    world_.move(drives_);
    ++cycle_;
    if (steps_ > 0) --steps_;
  }
  for (std::size_t i = 0; i < stations_.size(); ++i) {
    Station& station = *stations_[i];
    station.waits = !goes_on && time_ == Time::kPaused && station.robot.moving();
    if (goes_on) {
      station.robot.sense(world_.truth(i));
    } else if (!station.waits) {
      station.robot.stand_still();
    }
  }
  if (!lockstep_) pace_.steady();
  for (const auto& station : stations_) {
    station->waits ? station->robot_server.repeat() : station->robot_server.publish(lockstep_ ? 0 : pace_.period());
    station->gripper_server.publish();
  }
  if (goes_on) world_.settle();  // while the clients have their state already
  for (std::size_t i = 0; goes_on && i < stations_.size(); ++i) {
    Station& station = *stations_[i];
    if (station.truth) station.truth->append(world_, i, cycle_, station.robot.moving());
  }
  pace_.done();
}

// Whether the world has another cycle.
bool Cell::goes_on() const {
  if (time_ == Time::kRuns || steps_ > 0) return true;
  return time_ == Time::kBetweenMotionsPaused && std::any_of(stations_.begin(), stations_.end(), [](const auto& station) {
           return station->command || station->robot.under_way() || station->gripper.under_way();
         });
}

// Whether in lockstep the cycle waits for this arm's command. Where time stands still between motions it waits for the
// first of a motion as well, which therefore answers the state that showed it the motion, in every run.
bool Cell::awaited(const Station& station) const {
  if (station.command || station.robot_server.in_vain() || (time_ == Time::kPaused && steps_ == 0)) return false;
  if (station.robot.awaits_command()) return true;
  return time_ == Time::kBetweenMotionsPaused && station.robot.moving() && !station.robot.under_way() &&
         station.robot.state().robot_mode == fci::RobotMode::kMove;
}

bool Cell::awaited() const {
  return std::any_of(stations_.begin(), stations_.end(), [this](const auto& station) { return awaited(*station); });
}

void Cell::receive_commands() {
  // One that came before a pause has been answered by then, and does not come again.
  for (auto& station : stations_) {
    if (!station->robot.moving()) station->command = nullptr;
  }
  if (!lockstep_) return keep_pace();
  serve();
  // Also of arms that are not waited for: one whose motion is to begin while another's runs. What comes in a pause stays where it is.
  if (time_ != Time::kPaused || steps_ > 0) take_commands();
  if (!awaited()) {
    // Nobody is waited for where every command has come already, or the loss of the one that has not is known.
    const bool answered = std::any_of(stations_.begin(), stations_.end(), [](const auto& station) {
      return station->command || (station->robot.awaits_command() && station->robot_server.in_vain());
    });
    return answered && goes_on() ? pace_.restart() : keep_pace();
  }
  wait_for_commands(time_ == Time::kBetweenMotionsPaused ? kLonger * patience_ / 10 : patience_);
  const bool came = std::any_of(stations_.begin(), stations_.end(), [](const auto& station) {
    return station->command || station->robot.awaits_command();
  });
  pace_.restart();  // this computer was not late
  // The motion was stopped, or its client has gone: from here on time is the wall's again.
  if (!came) keep_pace();
}

// Of arms that have none yet.
void Cell::take_commands() {
  for (auto& station : stations_) {
    if (!station->command) station->command = station->robot_server.receive();
  }
}

void Cell::keep_pace() {
  for (auto& station : stations_) {
    while (const auto due = station->robot_server.next_delayed()) {
      if (lockstep_ || *due >= pace_.next()) break;
      pace_.wait_until(*due);
      station->robot_server.send_delayed(*due);
    }
  }
  // When the simulator itself was late, clients on the same computer were held up as well, and have had their state late:
  // they still have as long as a cycle is.
  const bool late = pace_.wait();
  serve();
  if (time_ == Time::kPaused && steps_ == 0) return;  // what came stays where it is
  take_commands();
  const std::int64_t patience = lockstep_ ? patience_ : std::max(late ? pace_.period() : 0, pace_.grace() - clock_.now());
  if (patience <= 0 || !awaited()) return;
  const std::int64_t before = clock_.now();
  wait_for_commands(patience);
  if (awaited()) pace_.waited_in_vain(clock_.now() - before);
}

void Cell::wait_for_commands(std::int64_t patience) {
  const std::int64_t until = clock_.now() + patience;
  while (!*stopped_) {
    for (auto& station : stations_) {
      if (awaited(*station)) station->command = station->robot_server.wait(until);
    }
    take_commands();  // the first of another arm's motion meanwhile
    if (!awaited() || clock_.now() >= until) return;
    serve();
  }
}

void Cell::serve() {
  const bool ready = poller_.ready();
  for (auto& station : stations_) {
    if (ready || station->robot_server.due()) station->robot_server.serve();
    if (ready || station->gripper_server.due()) station->gripper_server.serve();
  }
  const std::int64_t before = clock_.now();
  if (mailbox_.serve()) pace_.postpone(clock_.now() - before);
}

// --- time -----------------------------------------------------------------------------------------------------

void Cell::set_time(Time time) {
  time_ = time;
  steps_ = 0;
}

void Cell::step(std::uint64_t cycles) {
  if (time_ == Time::kRuns) throw std::runtime_error("time runs: pause it before single cycles are asked for");
  if (steps_ > 0) throw std::runtime_error(std::to_string(steps_) + " cycles that were asked for are still to come: wait until they are over");
  steps_ = cycles;
}

// --- moments --------------------------------------------------------------------------------------------------

const Cell::Moment& Cell::moment(std::uint64_t number) const {
  const auto found = moments_.find(number);
  if (found != moments_.end()) return found->second;
  std::string numbers;
  for (const auto& [kept, moment] : moments_) numbers += (numbers.empty() ? "" : ", ") + std::to_string(kept);
  throw std::runtime_error("there is no moment " + std::to_string(number) + ": it was never saved, or is forgotten; there " +
                           (numbers.empty() ? "is none" : "are " + numbers));
}

std::uint64_t Cell::save() {
  if (moments_.size() >= kMostMoments) {
    throw std::runtime_error(std::to_string(kMostMoments) + " moments are kept already, which is all there is room for: "
                             "forget one first, the oldest is " + std::to_string(moments_.begin()->first));
  }
  Moment moment;
  for (const auto& station : stations_) {
    moment.arms.emplace_back(station->robot_server.save(), station->gripper_server.save());
  }
  moment.world = world_.save();
  moments_.emplace(++last_moment_, std::move(moment));
  return last_moment_;
}

void Cell::restore(std::uint64_t number) {
  const Moment& moment = this->moment(number);
  for (std::size_t i = 0; i < stations_.size(); ++i) {
    stations_[i]->robot_server.require_restorable(moment.arms[i].first);
  }
  world_.restore(*moment.world);
  for (std::size_t i = 0; i < stations_.size(); ++i) {
    stations_[i]->command = nullptr;
    stations_[i]->robot_server.restore(moment.arms[i].first);
    stations_[i]->gripper_server.restore(moment.arms[i].second);
  }
}

void Cell::forget(std::uint64_t number) {
  static_cast<void>(moment(number));
  moments_.erase(number);
}

}  // namespace sim
