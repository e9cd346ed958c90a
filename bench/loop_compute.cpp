// What the 1 kHz loop needs from a state in hand to the command that answers it, the network left out:
// Record::compute_ns of every cycle in which a skill runs, takeovers included, for each combination of trajectory
// and controller that there is. The arm is fci-sim, in a process of its own.
//   loop_compute_us_p50, _p99   in lockstep (states as fast as both can); the worst combination of each
//   loop_compute_paced_us_p50   in real time, of the combination with the highest p50 in lockstep
//   loop_allocations            of the loop's thread in all of this

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "models/arm.hpp"
#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/controllers/internal_impedance.hpp"
#include "realtime/controllers/joint_impedance.hpp"
#include "realtime/loop.hpp"
#include "realtime/rotation.hpp"
#include "realtime/trajectories/min_jerk_joint.hpp"
#include "realtime/trajectories/min_jerk_pose.hpp"
#include "realtime/trajectories/relative_min_jerk_joint.hpp"
#include "realtime/trajectories/relative_min_jerk_pose.hpp"
#include "robot/fci_driver.hpp"
#include "robot/socket.hpp"
#include "server/realtime_setup.hpp"
#include "tests/realtime/allocation_counter.hpp"

namespace {

using namespace realtime;
using namespace std::chrono_literals;

constexpr std::size_t kCycles = 10'000;  // at least, of each combination
constexpr int kRobotStart = 20;          // s for fci-sim to answer
constexpr double kDuration = 0.8;        // s of each motion
constexpr double kPreempt = 0.5;         // s after which every second motion is replaced by the next

using Make = std::function<std::unique_ptr<Skill>(int turn)>;  // there and back, by turns

struct Combination {
  std::string name;
  Make make;
};

std::vector<Combination> combinations(const models::Limits& limits, const Eigen::Isometry3d& home) {
  const Vector7 q = Vector7::Map(models::kHome.data());
  const auto orientation = [home](int turn) {
    return realtime::exp(0.3 * (turn % 2) * Vector3::UnitX()) * Eigen::Quaterniond(home.linear());
  };
  using MakeTrajectory = std::function<std::unique_ptr<TrajectoryGenerator>(int)>;
  const std::vector<std::pair<std::string, MakeTrajectory>> trajectories = {
      {"MinJerkJoint",
       [=](int turn) {
         return std::make_unique<MinJerkJoint>(MinJerkJoint::Parameters{q.array() + 0.15 * (turn % 2), kDuration},
                                               limits);
       }},
      {"RelativeMinJerkJoint",
       [=](int turn) {
         return std::make_unique<RelativeMinJerkJoint>(
             RelativeMinJerkJoint::Parameters{Vector7::Constant(turn % 2 == 1 ? 0.1 : -0.1), kDuration}, limits);
       }},
      {"MinJerkPose",
       [=](int turn) {
         const Vector3 position = home.translation() + 0.08 * (turn % 2) * Vector3(1, 1, 1);
         return std::make_unique<MinJerkPose>(MinJerkPose::Parameters{position, orientation(turn), kDuration}, limits);
       }},
      {"RelativeMinJerkPose", [=](int turn) {
         const double way = turn % 2 == 1 ? 1 : -1;
         return std::make_unique<RelativeMinJerkPose>(
             RelativeMinJerkPose::Parameters{0.05 * way * Vector3(1, 1, 1), realtime::exp(0.2 * way * Vector3::UnitX()),
                                             RelativeMinJerkPose::Frame::kBase, kDuration},
             limits);
       }}};

  using MakeController = std::function<std::unique_ptr<Controller>()>;
  const Vector7 stiffness = (Vector7() << 600, 600, 600, 600, 250, 150, 50).finished();
  const Vector7 damping = (Vector7() << 50, 50, 50, 50, 30, 25, 15).finished();
  const std::vector<std::pair<std::string, MakeController>> controllers = {
      {"JointImpedance",
       [=] {
         return std::make_unique<JointImpedance>(JointImpedance::Parameters{stiffness, damping});
       }},
      {"CartesianImpedance",
       [] {
         return std::make_unique<CartesianImpedance>(
             CartesianImpedance::Parameters{Vector3::Constant(600), Vector3::Constant(50), 1, 10});
       }},
      {"InternalImpedance K_theta",
       [] {
         return std::make_unique<InternalImpedance>(
             InternalImpedance::Parameters{Vector7(Vector7::Constant(2000)), {}});
       }},
      {"InternalImpedance K_x", [] {
         return std::make_unique<InternalImpedance>(
             InternalImpedance::Parameters{{}, (Vector6() << 2000, 2000, 2000, 200, 200, 200).finished()});
       }}};

  std::vector<Combination> all;
  for (const auto& [trajectory_name, trajectory] : trajectories) {
    for (const auto& [controller_name, controller] : controllers) {
      if (!controller()->accepts(trajectory(0)->reference_kind())) continue;
      all.push_back({trajectory_name + " x " + controller_name, [trajectory, controller](int turn) {
                       auto skill = std::make_unique<Skill>();
                       skill->trajectory = trajectory(turn);
                       skill->controller = controller();
                       skill->mode = skill->controller->mode(skill->trajectory->reference_kind());
                       skill->settings = skill->controller->settings();
                       return skill;
                     }});
    }
  }
  return all;
}

// fci-sim on a loopback address of its own, until it is destroyed.
class Simulator {
 public:
  explicit Simulator(bool lockstep) {
    std::random_device random;
    const auto byte = [&] { return std::to_string(std::uniform_int_distribution<>(2, 250)(random)); };
    address_ = "127." + byte() + "." + byte() + "." + byte();
    const auto program =
        std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path() / "bin" / "fci-sim";
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(STDERR_FILENO, STDOUT_FILENO);
      ::execl(program.c_str(), "fci-sim", "--robot", "fr3", "--listen", address_.c_str(),
              lockstep ? "--lockstep" : nullptr, nullptr);
      std::perror(program.c_str());
      ::_exit(127);
    }
  }
  ~Simulator() {
    ::kill(pid_, SIGTERM);
    ::waitpid(pid_, nullptr, 0);
  }
  Simulator(const Simulator&) = delete;

  std::unique_ptr<robot::FciDriver> connect() const {
    for (const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(kRobotStart);;) {
      try {
        return robot::FciDriver::connect(address_);
      } catch (const robot::ConnectError&) {
        if (std::chrono::steady_clock::now() > until) throw;
        std::this_thread::sleep_for(50ms);
      }
    }
  }

 private:
  std::string address_;
  ::pid_t pid_ = -1;
};

// A loop in a thread of its own, with the server room's work for it.
class Running {
 public:
  explicit Running(bool lockstep)
      : simulator_(lockstep),
        driver_(simulator_.connect()),
        limits_(models::limits(models::arm("fr3"), driver_->version())),
        model_(models::urdf(models::arm("fr3"), driver_->version())),
        loop_(*driver_, model_, limits_, Loop::Options{}, door_),
        thread_([this] {
          server::RealtimeReport report;
          server::prepare_thread(0, report);
          const testing_tools::AllocationCounter counter;
          loop_.run();
          allocations_ = counter.count();
        }) {}

  ~Running() { end(); }

  // Nanoseconds of at least that many cycles of the combination.
  std::vector<std::int64_t> measure(const Combination& combination, std::size_t cycles) {
    std::vector<std::int64_t> samples;
    samples.reserve(2 * cycles + 4096);
    const std::uint64_t first = next_id_;
    std::uint64_t current = 0;  // the skill handed over last
    bool ended = true;
    for (int turn = 1; samples.size() < cycles || !ended;) {
      double time = 0;
      while (const Record* record = door_.records.front()) {
        if (record->compute_ns > 0 && record->phase == Phase::kRunning && record->skill_id >= first) {
          samples.push_back(record->compute_ns);
          if (record->skill_id == current) time = record->skill_time;
        }
        door_.records.pop();
      }
      while (const SkillResult* result = door_.results.front()) {
        if (result->ending != Ending::kTerminated && result->ending != Ending::kPreempted) {
          throw std::runtime_error(combination.name + " ended with " +
                                   std::to_string(static_cast<int>(result->ending)));
        }
        ended |= result->skill_id == current;
        door_.results.pop();
      }
      destroy_retired();
      if (samples.size() < cycles && (ended || (turn % 2 == 0 && time > kPreempt))) {
        auto skill = combination.make(turn++);
        skill->id = current = next_id_++;
        ended = false;
        door_.next.put(std::move(skill));
      }
      std::this_thread::sleep_for(200us);
    }
    return samples;
  }

  const models::Limits& limits() const { return limits_; }

  // Ends the loop; what its thread has taken from the heap.
  std::uint64_t finish() {
    end();
    if (door_.records_lost > 0) throw std::runtime_error("records were lost: the figures would be incomplete");
    return allocations_;
  }

 private:
  void end() {
    if (!thread_.joinable()) return;
    door_.quit = true;
    thread_.join();
    destroy_retired();
  }
  void destroy_retired() {
    while (Skill* const* skill = door_.retired.front()) {
      delete *skill;
      door_.retired.pop();
    }
  }

  Simulator simulator_;
  std::unique_ptr<robot::FciDriver> driver_;
  const models::Limits& limits_;
  Model model_;
  Door door_;
  Loop loop_;
  std::uint64_t next_id_ = 1;
  std::uint64_t allocations_ = 0;
  std::thread thread_;
};

double percentile(std::vector<std::int64_t>& ns, double share) {
  const auto at = ns.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(ns.size() - 1));
  std::nth_element(ns.begin(), at, ns.end());
  return 1e-3 * static_cast<double>(*at);
}

Eigen::Isometry3d home_pose() {
  Model model(models::urdf(models::arm("fr3"), 10));
  Eigen::Isometry3d F_T_EE(Eigen::AngleAxisd(models::hand::kYaw, Vector3::UnitZ()));
  F_T_EE.translation().z() = models::hand::kTcp;
  model.set_tool(0, Vector3::Zero(), Eigen::Matrix3d::Zero(), F_T_EE);
  return model.O_T_EE(Vector7::Map(models::kHome.data()));
}

}  // namespace

int main() try {
  double p50 = 0, p99 = 0;
  std::uint64_t allocations = 0;
  std::size_t slowest = 0;
  std::vector<Combination> all;
  {
    Running running(true);
    all = combinations(running.limits(), home_pose());
    for (std::size_t i = 0; i < all.size(); ++i) {
      running.measure(all[0], 1);  // from the same posture
      auto ns = running.measure(all[i], kCycles);
      const double half = percentile(ns, 0.5), most = percentile(ns, 0.99);
      std::fprintf(stderr, "%-46s p50 %6.2f us  p99 %6.2f us  of %zu cycles\n", all[i].name.c_str(), half, most,
                   ns.size());
      if (half > p50) slowest = i;
      p50 = std::max(p50, half);
      p99 = std::max(p99, most);
    }
    allocations += running.finish();
  }
  Running paced(false);
  auto ns = paced.measure(all[slowest], kCycles);
  const double paced_p50 = percentile(ns, 0.5);
  std::fprintf(stderr, "%-46s p50 %6.2f us  p99 %6.2f us  at 1 kHz\n", all[slowest].name.c_str(), paced_p50,
               percentile(ns, 0.99));
  allocations += paced.finish();
  std::printf(
      "{\"loop_compute_us_p50\": %.3f, \"loop_compute_us_p99\": %.3f, \"loop_compute_paced_us_p50\": %.3f, "
      "\"loop_allocations\": %llu}\n",
      p50, p99, paced_p50, static_cast<unsigned long long>(allocations));
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "loop_compute: %s\n", error.what());
  return 1;
}
