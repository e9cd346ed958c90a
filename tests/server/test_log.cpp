#include <gtest/gtest.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/base_sink.h>

#include <condition_variable>
#include <mutex>
#include <string>
#include <vector>

#include "server/log.hpp"

namespace server {
namespace {

// A terminal that may be paused.
class Terminal : public spdlog::sinks::base_sink<std::mutex> {
 public:
  void go_on() {
    const std::lock_guard lock(mine_);
    paused_ = false;
    changed_.notify_all();
  }
  std::vector<std::string> lines() {
    const std::lock_guard lock(mine_);
    return lines_;
  }

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    std::unique_lock lock(mine_);
    changed_.wait(lock, [this] { return !paused_; });
    lines_.emplace_back(message.payload.data(), message.payload.size());
  }
  void flush_() override {}

  std::mutex mine_;
  std::condition_variable changed_;
  bool paused_ = true;
  std::vector<std::string> lines_;
};

TEST(Log, ATerminalThatIsPausedStopsNobody) {
  const auto terminal = std::make_shared<Terminal>();
  spdlog::logger log("test", make_patient_sink(terminal));
  for (int i = 0; i < 5000; ++i) log.info("line {}", i);
  EXPECT_TRUE(terminal->lines().empty());
  terminal->go_on();
  while (terminal->lines().empty() || !terminal->lines().back().ends_with("did not take them")) log.flush();
  const auto lines = terminal->lines();
  EXPECT_EQ(lines.front(), "line 0");
  // One was under way when the queue filled, or none.
  const auto written = lines.size() - 1;
  EXPECT_TRUE(written == 1000 || written == 1001) << written;
  EXPECT_EQ(lines.back(), std::to_string(5000 - written) + " lines of the log were dropped here: what shows it did not take them");

  log.info("after");
  while (terminal->lines().back() != "after") log.flush();
}

}  // namespace
}  // namespace server
