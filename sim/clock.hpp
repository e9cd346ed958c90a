#pragma once

#include <cstdint>
#include <ctime>

namespace sim {

// The wall's 1 kHz, on absolute deadlines. Cycles are never skipped and never made up for: when one was
// late, all that follow are as late.
class Clock {
 public:
  // As far behind its deadline a cycle may be done and the next still come at its time.
  static constexpr std::int64_t kTolerance = 200'000;  // ns

  Clock();

  // Sleeps until the cycle begins, or a signal comes. Whether it begins late.
  bool wait();
  // The cycle is done, its state sent.
  void done();
  // The cycle began when its command came, not at a time.
  void restart() { deadline_ = now(); }

  std::uint64_t late() const { return late_; }              // cycles
  double worst_delay() const { return 1e-9 * static_cast<double>(worst_); }  // s

  static std::int64_t now();  // ns

 private:
  std::int64_t deadline_;  // ns
  std::uint64_t late_ = 0;
  std::int64_t worst_ = 0;
};

}  // namespace sim
