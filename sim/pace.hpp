#pragma once

#include "sim/clock.hpp"

namespace sim {

// A clock's 1 kHz, or a multiple of it, on absolute deadlines; cycles are never skipped. One that is done late does not
// move the next, but a client then has until grace() to answer. One that is later than a whole cycle moves those that
// follow, so that there is no burst; they make up for it by a quarter of a cycle each, so that the rate is right.
class Pace {
 public:
  // speed: of the robot's time over the clock's.
  explicit Pace(Clock& clock, double speed = 1);

  // Sleeps until the cycle begins, or a signal comes. Whether it begins late.
  bool wait();
  // Sleeps until a time before that, if it is one.
  void wait_until(std::int64_t time);
  // Waits for the few µs until states are sent as late after the beginning of their cycle as most: what a cycle takes differs
  // from one to the next, and when a robot's states come does not.
  void steady();
  // The cycle is done, its state sent.
  void done();
  // The cycle began when its command came, not at a time.
  void restart() {
    deadline_ = clock_.now();
    behind_ = 0;
  }
  // For so long (ns), for a command that did not come: that is no lateness of this computer's.
  void waited_in_vain(std::int64_t time) { in_vain_ = time; }
  // Something else was done for so long (ns), by intention.
  void postpone(std::int64_t time) { deadline_ += time; }

  std::int64_t period() const { return period_; }                            // ns
  std::int64_t next() const { return deadline_ + period_; }                  // ns: when the next cycle begins
  std::int64_t grace() const { return done_ + period_; }                     // ns: a cycle after the last state was sent
  std::uint64_t late() const { return late_; }                               // cycles
  double worst_delay() const { return 1e-9 * static_cast<double>(worst_); }  // s

 private:
  Clock& clock_;
  const std::int64_t period_;
  const std::int64_t tolerance_;  // ns after its deadline from which a cycle counts as late: 0.2 ms
  std::int64_t deadline_, done_;
  std::int64_t in_vain_ = 0;  // ns, of this cycle
  std::int64_t behind_ = 0;  // ns, to be made up for
  std::int64_t usual_ = 0;   // ns from the deadline until states are sent
  std::uint64_t late_ = 0;
  std::int64_t worst_ = 0;
};

}  // namespace sim
