// Anything that a script can send to a simulated arm's control channel: an answer, never a crash, and no arm that moves
// under a command which nobody has given, or to where no number is.

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "models/arm.hpp"
#include "require.hpp"
#include "script.hpp"
#include "sim/door/control/control_calls.hpp"

namespace {

constexpr std::uint32_t kMostCycles = 200;  // in one call

using fuzz::are_numbers;
using fuzz::require;

// Time that does not wait for the wall's, and lets others have the processor.
class Haste final : public sim::Clock {
 public:
  std::int64_t now() const override { return now_; }
  void sleep_until(std::int64_t time) override {
    now_ = std::max(now_, time);
    std::this_thread::yield();
  }
  void wait_for(int, std::int64_t time) override { sleep_until(time); }

 private:
  std::int64_t now_ = 1'000'000'000;  // ns
};

// An arm on its table whose cycles a thread of its own runs, as in fci-sim.
class Arm {
 public:
  Arm() {
    std::random_device random;
    while (!cell_) {
      const auto part = [&] { return std::to_string(random() % 250 + 2); };
      sim::Cell::Options options;
      options.scene = "table_with_blocks";
      options.arms = {{&models::arm("fr3"), sim::parse_address("127." + part() + "." + part() + "." + part()), ""}};
      try {
        cell_ = std::make_unique<sim::Cell>(options, clock_);
      } catch (const std::runtime_error& error) {
        if (std::string(error.what()).find("taken") == std::string::npos) throw;
      }
    }
    calls_ = std::make_unique<sim::ControlCalls>(*cell_, 0);
    start_ = cell_->save();
    thread_ = std::thread([this] { cell_->run(ended_); });
  }
  ~Arm() {
    cell_->ask([this] { ended_ = 1; });
    thread_.join();
  }

  void run(fuzz::Script script) {
    int what = 0;
    std::span<const std::byte> bytes;
    while (script.next(what, bytes)) {
      if (takes_long(bytes)) continue;
      frankapy::proto::SimulationReply reply;
      require(reply.ParseFromString(calls_->answer(bytes)), "an answer that is none");
      require(reply.answer_case() != frankapy::proto::SimulationReply::ANSWER_NOT_SET, "an empty answer");
      require(!reply.has_error() || !reply.error().empty(), "an error that says nothing");
      if (reply.has_moment()) saved_.push_back(reply.moment());
      cell_->ask([this] { look(); });
    }
  }

  // For the next input; false: there is no way back.
  bool begin_anew() {
    const auto done = [this](auto&& task) {
      try {
        cell_->ask(task);
        return true;
      } catch (const std::runtime_error&) {
        return false;
      }
    };
    for (const std::uint64_t moment : saved_) done([&] { cell_->forget(moment); });
    saved_.clear();
    return done([this] {
      cell_->restore(start_);
      cell_->set_time(sim::Cell::Time::kRuns);
    });
  }

 private:
  // What is to take its time: pictures, which are drawn by others, and many cycles.
  static bool takes_long(std::span<const std::byte> bytes) {
    frankapy::proto::SimulationCall call;
    if (!call.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return false;
    return call.has_take_image() || call.step().cycles() > kMostCycles;
  }

  void look() {
    const fci::RobotState& state = cell_->robot(0).state();
    require(!cell_->robot(0).moving(), "a motion without a Move");
    require(are_numbers(state.q) && are_numbers(state.dq) && are_numbers(state.tau_J), "a state that is no number");
    require(are_numbers(cell_->world().qpos()), "a place that is no number");
  }

  Haste clock_;
  std::unique_ptr<sim::Cell> cell_;
  std::unique_ptr<sim::ControlCalls> calls_;
  std::uint64_t start_ = 0;
  std::vector<std::uint64_t> saved_;  // since
  volatile std::sig_atomic_t ended_ = 0;
  std::thread thread_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static std::unique_ptr<Arm> arm;
  if (!arm) {
    spdlog::set_level(spdlog::level::off);
    arm = std::make_unique<Arm>();
  }
  arm->run({data, size});
  if (!arm->begin_anew()) arm = std::make_unique<Arm>();
  return 0;
}
