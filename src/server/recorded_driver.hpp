#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <thread>

#include "robot/driver.hpp"
#include "server/recorder.hpp"

namespace server {

// An arm in lockstep, which waits for its recorder: it may be fifty times as fast as a real one, and then a recorder that is not
// let run for a fifth of a second has lost what would have been ten.
class RecordedDriver final : public robot::Driver {
 public:
  RecordedDriver(robot::Driver& driver, const Recorder& recorder) : driver_(driver), recorder_(recorder) {}

  robot::Received receive(fci::RobotState& state) noexcept override {
    for (Milliseconds waited{0}; recorder_.behind() > kMost && waited < kMostOfCycle && stood_ < kMostOfAll; waited += kStep) {
      const std::uint64_t before = recorder_.been_through();
      std::this_thread::sleep_for(kStep);
      stood_ = recorder_.been_through() == before ? stood_ + kStep : Milliseconds(0);
    }
    if (recorder_.behind() <= kMost) stood_ = Milliseconds(0);
    return driver_.receive(state);
  }
  std::int64_t received_ns() const noexcept override { return driver_.received_ns(); }
  void send(const fci::RobotCommand& command) noexcept override { driver_.send(command); }
  std::optional<std::uint32_t> post(const robot::Request& request) noexcept override { return driver_.post(request); }
  std::optional<robot::Answer> poll() noexcept override { return driver_.poll(); }
  fci::Version version() const noexcept override { return driver_.version(); }

 private:
  using Milliseconds = std::chrono::milliseconds;

  // Records: as many as can come while the ten seconds of a black box are written, and none of them is lost.
  static constexpr std::uint64_t kMost = 4 * (BlackBox::kRecords - BlackBox::kKept) / 5;
  static constexpr Milliseconds kStep{1};
  static constexpr Milliseconds kMostOfCycle{100};  // less than a simulated arm waits for its command
  static constexpr Milliseconds kMostOfAll{2000};   // then the disk stands still, and costs the recording alone

  robot::Driver& driver_;
  const Recorder& recorder_;
  Milliseconds stood_{0};  // waited for a recorder that came no farther
};

}  // namespace server
