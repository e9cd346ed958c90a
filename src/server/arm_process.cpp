#include "server/arm_process.hpp"

#include <signal.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <future>
#include <memory>
#include <mutex>
#include <thread>

#include "realtime/joint_range.hpp"
#include "realtime/loop.hpp"
#include "robot/fci_driver.hpp"
#include "server/arm_model.hpp"
#include "server/doorkeeper.hpp"
#include "server/ending_signals.hpp"
#include "server/gripper.hpp"
#include "server/keys.hpp"
#include "server/part_record.hpp"
#include "server/publisher.hpp"
#include "server/realtime_setup.hpp"
#include "server/recorded_driver.hpp"
#include "server/recorder.hpp"
#include "server/registry.hpp"
#include "server/sensor_hub.hpp"
#include "server/sign_of_life.hpp"
#include "server/skill_builder.hpp"
#include "server/sockets.hpp"
#include "server/transport.hpp"
#include "server/wakeful_clock.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;
using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kHeartbeat = 100ms;
constexpr auto kReconnectPeriod = 500ms;
constexpr auto kTellPeriod = 2s;
// More than for others: an arm in lockstep, and what serves it, is silent as long as its computer has no time for it, which is no
// sign that it is gone.
constexpr auto kMorePatience = 9s;
constexpr auto kHandTime = 500ms;   // that a client's first look at the arm may wait for its hand

// The log as part of recordings.
class JournalSink : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit JournalSink(Journal& journal) : journal_(journal) {}

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    proto::LogLine line;
    const auto level = spdlog::level::to_string_view(message.level);
    line.set_level(std::string(level.data(), level.size()));
    line.set_text(std::string(message.payload.data(), message.payload.size()));
    journal_.note("/log", line.GetTypeName(), line.SerializeAsString());
  }
  void flush_() override {}

  Journal& journal_;
};

// While there is one, begun and ended where there are no other threads, the log goes into the journal too.
class JournalLogged {
 public:
  explicit JournalLogged(Journal& journal) { sinks().push_back(std::make_shared<JournalSink>(journal)); }
  ~JournalLogged() { sinks().pop_back(); }
  JournalLogged(const JournalLogged&) = delete;

 private:
  static std::vector<spdlog::sink_ptr>& sinks() { return spdlog::default_logger()->sinks(); }
};

class ArmProcess {
 public:
  ArmProcess(const ArmConfig& config, const RecordingsConfig& recordings, const ArmOptions& options, BlackBox& box)
      : config_(config),
        options_(options),
        keys_(keys_for(options.listen, options.keys)),
        context_(preferred_context()),
        doorkeeper_(keys_ ? std::make_unique<Doorkeeper>(context_, *keys_) : nullptr),
        door_(box.records),
        gripper_(config.gripper ? std::make_unique<Gripper>(config.address) : nullptr),
        publisher_(context_, {options.listen, keys_.get()}, options.state_port, door_, gripper_.get()),
        recorder_(box, recordings, config.name, gripper_.get()),
        sensors_(context_, {options.listen, keys_.get()}, options.sensor_port, box.journal, door_.robot_time, config.lockstep),
        transport_(context_, {options.listen, keys_.get()}, options.port, door_, publisher_, sensors_, recorder_, gripper_.get(),
                   WallStore(config.walls, options.status_fd >= 0 ? ArmOptions::kWallsFd : -1, walls_file(config)),
                   Transport::Options{.clock = {}, .recovery = config.recovery},
                   LimitStore(config.limits, options.status_fd >= 0 ? ArmOptions::kLimitsFd : -1)) {}

  int run() {
    spdlog::info("requests at {}, states at {}", transport_.endpoint(), publisher_.endpoint());
    realtime_ = prepare_process();
    std::thread transport([this] { transport_.run(transport_quit_); });
    std::promise<void> ended;
    std::thread robot([this, &ended] {
      keep_connected();
      ended.set_value();
    });
    watch();
    quit_ = true;
    door_.quit = true;
    changed_.notify_all();
    const auto end = ended.get_future();
    while (end.wait_for(kHeartbeat) != std::future_status::ready) report();  // it brakes, and does not hang
    robot.join();
    transport_quit_ = true;
    transport.join();
    return 0;
  }

  // Whether run() ended because the supervisor is gone.
  bool alone() const { return alone_; }

 private:
  // --- the thread of main(): signals, heartbeat, hangs ---

  void watch() {
    const sigset_t signals = ending_signals();
    constexpr timespec period{0, std::chrono::nanoseconds(kHeartbeat).count()};
    while (sigtimedwait(&signals, nullptr, &period) < 0) {
      check_threads();
      tell_not_taken();
      if (!report()) {
        spdlog::warn("the supervisor is gone: stopping");
        recorder_.keep("the-supervisor-is-gone");
        alone_ = true;
        return;
      }
    }
    spdlog::info("stopping");
  }

  // False when there is a supervisor no more.
  bool report() {
    if (options_.status_fd < 0) return true;
    proto::Arms::Arm arm;
    arm.set_name(config_.name);
    arm.set_address(config_.address);
    {
      const std::lock_guard lock(mutex_);
      arm.set_status(status_);
      if (ready_) {
        arm.set_endpoint(transport_.endpoint());
        arm.set_state_endpoint(publisher_.endpoint());
        arm.set_sensor_endpoint(sensors_.endpoint());
      }
    }
    const std::string bytes = arm.SerializeAsString();
    return send(options_.status_fd, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT) >= 0 ||
           errno == EAGAIN;
  }

  // What of the robot is not taken, where it becomes more.
  void tell_not_taken() {
    if (const auto now = Clock::now(); now - not_taken_told_at_ > kTellPeriod) {
      not_taken_told_at_ = now;
    } else {
      return;
    }
    const std::lock_guard lock(mutex_);
    std::string text = not_taken_ ? not_taken_->text() : "";
    if (text != not_taken_told_ && !text.empty()) spdlog::warn("of the robot was not taken so far: {}", text);
    not_taken_told_ = std::move(text);
  }

  // A hang ends the process: the supervisor starts it again, and the robot stops by its own reflex.
  void check_threads() {
    const auto now = clock_.now();
    const ArmOptions::Watchdogs& most = options_.watchdogs;
    const auto patience = config_.lockstep ? kMorePatience : 0ms;
    if (transport_alive_.silence(transport_.rounds(), true, now) > most.transport + patience) {
      hang("transport", part_record().in_loop);
    }
    // Each a sign of its own: a publisher that has trouble is no loop that hangs.
    const std::uint64_t cycles = door_.records.written();
    if (loop_alive_.silence(cycles, looping_, now) > most.loop + patience ||
        // Of a step only what passes in it: the robot may have been silent before.
        step_alive_.silence(cycles, looping_ && part_record().in_loop != 0, now) > most.part) {
      hang("1 kHz loop", part_record().in_builder);
    }
    const Workbench& bench = transport_.workbench();
    const std::uint64_t finished = bench.finished();
    const auto builder = builder_alive_.silence(finished, bench.begun() != finished && part_record().in_builder != 0, now);
    if (builder > most.builder) hang("skill builder", part_record().in_loop);
  }

  // What the other thread was in is not to blame.
  [[noreturn]] void hang(const char* thread, std::atomic<std::uint32_t>& other) {
    other = 0;
    spdlog::critical("the {} hangs{}: this process gives up", thread, part_record().where());
    spdlog::default_logger()->flush();
    std::_Exit(ArmOptions::kHangs);
  }

  // --- the robot's thread: connection after connection ---

  void keep_connected() {
    std::string told;
    while (!quit_) {
      std::string why;
      try {
        robot::FciTimes times;
        if (config_.lockstep) times.silence += kMorePatience;
        const auto driver = robot::FciDriver::connect(config_.address, times);
        told.clear();
        publisher_.count(driver->shared_counters());
        {
          const std::lock_guard lock(mutex_);
          not_taken_ = driver->shared_counters();
        }
        serve(*driver);
        const std::string not_taken = driver->counters().text();
        why = driver->lost() != nullptr ? driver->lost() : "no states arrive";
        if (driver->lost() == nullptr && !not_taken.empty()) why += " that can be used: " + not_taken;
        why = "the connection to the robot at " + config_.address + " was lost: " + why;
      } catch (const std::exception& error) {
        why = error.what();
      }
      if (quit_) why = "the server is stopping";
      set_status(why, false);
      transport_.disconnected(why);
      if (!quit_ && why != told) spdlog::error("{}", why);
      told = why;
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, kReconnectPeriod, [this] { return quit_.load(); });
    }
  }

  void serve(robot::FciDriver& driver) {
    const ArmModel chosen = choose_model(driver.version(), driver.robot_model(), config_.model);
    const models::Limits limits = scaled_limits(chosen, driver.version(), config_);
    realtime::Model model(chosen.urdf);
    auto builder = std::make_shared<SkillBuilder>(std::make_unique<realtime::Model>(chosen.urdf), limits,
                                                  config_.settings.collision_behavior.value_or(robot::kCollisionBehavior));

    RecordedDriver recorded(driver, recorder_);
    realtime::Loop loop(config_.lockstep ? static_cast<robot::Driver&>(recorded) : driver, model, limits,
                        {config_.hold_time, config_.settings, {options_.allocations, &part_record().in_loop}}, door_);
    RealtimeReport report = realtime_;
    std::promise<void> prepared, go;
    std::thread thread([&] {
      prepare_thread(options_.index, config_.processor, !config_.lockstep, report);
      prepared.set_value();
      go.get_future().wait();
      looping_ = true;
      loop.run();
      looping_ = false;
    });
    prepared.get_future().wait();
    if (!chosen.warning.empty()) report.deficiencies.push_back(chosen.warning);
    tell(driver, chosen, report);
    if (gripper_) gripper_->wait_for_first_attempt(kHandTime);
    transport_.connected(std::move(builder), welcome(driver, chosen, limits, report));
    go.set_value();
    set_status("ready", true);
    thread.join();
  }

  void tell(const robot::FciDriver& driver, const ArmModel& chosen, const RealtimeReport& report) const {
    spdlog::info("robot at {}: {}, protocol version {}", config_.address, chosen.arm->title, driver.version());
    spdlog::info("kernel {}; scheduling {}; memory {}", report.kernel, report.scheduling, report.memory);
    for (const auto& deficiency : report.deficiencies) spdlog::warn("{}", deficiency);
  }

  proto::Welcome welcome(const robot::FciDriver& driver, const ArmModel& chosen, const models::Limits& limits,
                         const RealtimeReport& report) const {
    proto::Welcome welcome;
    welcome.set_arm(config_.name);
    welcome.set_model(std::string(chosen.arm->name));
    welcome.set_address(config_.address);
    welcome.set_protocol_version(driver.version());
    auto& out = *welcome.mutable_limits();
    for (int i = 0; i < models::kJoints; ++i) {
      out.add_q_min(limits.q_min[i]);
      out.add_q_max(limits.q_max[i]);
      out.add_dq_max(limits.dq_max[i]);
      out.add_rest_min(realtime::rest_min(limits, i));
      out.add_rest_max(realtime::rest_max(limits, i));
    }
    double moving_mass = 0;
    for (std::size_t i = 1; i < chosen.arm->links.size(); ++i) moving_mass += chosen.arm->links[i].mass;
    welcome.set_moving_mass(moving_mass);
    for (const auto& deficiency : report.deficiencies) welcome.add_deficiencies(deficiency);
    if (auto loaded = loaded_kinds(); !loaded.kinds().empty()) *welcome.mutable_loaded() = std::move(loaded);
    return welcome;
  }

  void set_status(const std::string& status, bool ready) {
    const std::lock_guard lock(mutex_);
    status_ = status;
    ready_ = ready;
  }

  const ArmConfig config_;
  const ArmOptions options_;
  const std::unique_ptr<Keys> keys_;
  zmq::context_t context_;
  const std::unique_ptr<Doorkeeper> doorkeeper_;  // null: no keys
  realtime::Door door_;
  std::unique_ptr<Gripper> gripper_;
  Publisher publisher_;
  Recorder recorder_;
  SensorHub sensors_;
  Transport transport_;
  RealtimeReport realtime_;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::string status_ = "starting";
  bool ready_ = false;
  bool alone_ = false;
  std::shared_ptr<const robot::FciDriver::Counters> not_taken_;
  std::string not_taken_told_;
  Clock::time_point not_taken_told_at_{};
  std::atomic<bool> quit_{false}, transport_quit_{false}, looping_{false};

  WakefulClock clock_{2 * kHeartbeat};
  SignOfLife transport_alive_, loop_alive_, step_alive_, builder_alive_;  // by it
};

}  // namespace

int run_arm(const ArmConfig& config, const RecordingsConfig& recordings, const ArmOptions& options) {
  // For watch(), and blocked in all threads, which inherit it.
  const sigset_t signals = ending_signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  spdlog::set_pattern("[%H:%M:%S.%e] [" + config.name + "] %^%l%$ %v");
  try {
    if (options.status_fd >= 0) use(map_part_record(ArmOptions::kRecordFd));
    part_record().describe(titles_of_kinds());
    BlackBox box = options.status_fd >= 0 ? BlackBox::in(ArmOptions::kBlackBoxFd) : BlackBox();
    const JournalLogged logged(box.journal);
    auto process = std::make_unique<ArmProcess>(config, recordings, options, box);
    const int status = process->run();
    const bool alone = process->alone();
    process.reset();
    if (alone) forget_black_box(ArmOptions::kBlackBoxFd);  // all is written
    return status;
  } catch (const std::exception& error) {
    spdlog::critical("{}", error.what());
    return EXIT_FAILURE;
  }
}

}  // namespace server
