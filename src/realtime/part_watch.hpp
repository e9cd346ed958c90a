#pragma once

#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <ctime>

namespace realtime {

// What a part did that does not belong into the loop.
struct PartFault {
  enum class Why : std::uint8_t {
    kNone,
    kNotFinite,  // gave NaN or infinity
    kTooLong,    // took too long, again and again
    kAllocates,  // took memory from the heap
  };
  Why why = Why::kNone;
  std::uint16_t part = 0;  // its number, as Skill has it
  std::int64_t ns = 0;     // kTooLong: that its last step took
};

// Stands beside every step of a part: says which one the loop is in, how long it took, and whether it took memory.
//
// A step may take kBudget. Wall time is measured always; it blames nobody, since the kernel may have let the thread wait.
// A part that exceeds it has its next kWindow steps measured by the thread's processor time as well (which is a system
// call), unless it is the part that lets the thread wait: it is at fault when kMostLong of them take longer than the budget,
// or kMostVeryLong longer than kVeryLong. One long step alone is no fault: interrupts and a stalled virtual machine are
// charged to whom they interrupt.
class PartWatch {
 public:
  static constexpr std::int64_t kBudget = 300'000, kVeryLong = 1'000'000;  // ns
  static constexpr int kWindow = 100, kMostLong = 30, kMostVeryLong = 10;

  // What belongs to the process; either may be null.
  struct Hooks {
    std::uint64_t (*allocations)() noexcept = nullptr;  // that the calling thread has made so far
    std::atomic<std::uint32_t>* in_part = nullptr;      // number of the part that the loop is in; 0: in none
  };

  // Places of parts; terminations have one each.
  static constexpr int kTrajectory = 0, kController = 1, kTerminations = 2;

  explicit PartWatch(const Hooks& hooks) : hooks_(hooks) {}

  // Other parts from now on, none of them at fault.
  void reset() noexcept {
    slots_.fill({});
    fault_ = longest_ = {};
  }

  // Of the parts since reset(): the first fault; and the longest step in wall time, whatever made it so long.
  const PartFault& fault() const noexcept { return fault_; }
  const PartFault& longest() const noexcept { return longest_; }
  bool at_fault() const noexcept { return fault_.why != PartFault::Why::kNone; }
  bool at_fault(int role) const noexcept { return slot(role).at_fault; }

  void not_finite(int role, std::uint16_t number) noexcept { blame(slot(role), {PartFault::Why::kNotFinite, number, 0}); }

  // Calls a part's step() and gives back its answer.
  template <class Step>
  bool step(int role, std::uint16_t number, Step step) noexcept {
    Slot& slot = this->slot(role);
    const bool closely = slot.closely > 0;
    const std::int64_t used = closely ? now(CLOCK_THREAD_CPUTIME_ID) : 0;
    const long waits = closely ? this->waits() : 0;
    const std::int64_t began = now(CLOCK_MONOTONIC);
    const bool answer = call(slot, number, step);
    const std::int64_t wall = note(number, began);
    if (closely) {
      const bool never_waits = wall > kBudget && this->waits() == waits;
      judge(slot, number, never_waits ? std::min(wall, now(CLOCK_THREAD_CPUTIME_ID) - used) : wall);
    } else if (wall > kBudget) {
      slot.closely = kWindow;
      slot.number_long = slot.number_very_long = 0;
    }
    return answer;
  }

  // Calls its start(), which may take longer.
  template <class Start>
  void start(int role, std::uint16_t number, Start start) noexcept {
    const std::int64_t began = now(CLOCK_MONOTONIC);
    call(slot(role), number, [&] { return start(), true; });
    note(number, began);
  }

 private:
  struct Slot {
    int closely = 0;  // steps that are still measured by processor time
    int number_long = 0, number_very_long = 0;  // of them
    bool at_fault = false;
  };

  // How often this thread has given its processor away of itself.
  static long waits() noexcept {
    rusage used;
    return ::getrusage(RUSAGE_THREAD, &used) == 0 ? used.ru_nvcsw : 0;
  }

  // Returns how long it took, ns.
  std::int64_t note(std::uint16_t number, std::int64_t began) noexcept {
    const std::int64_t wall = now(CLOCK_MONOTONIC) - began;
    if (wall > longest_.ns) longest_ = {PartFault::Why::kTooLong, number, wall};
    return wall;
  }

  static std::int64_t now(clockid_t clock) noexcept {
    timespec now;
    ::clock_gettime(clock, &now);
    return now.tv_sec * 1'000'000'000ll + now.tv_nsec;
  }

  Slot& slot(int role) noexcept { return slots_[std::min<std::size_t>(role, slots_.size() - 1)]; }
  const Slot& slot(int role) const noexcept { return slots_[std::min<std::size_t>(role, slots_.size() - 1)]; }

  template <class Function>
  bool call(Slot& slot, std::uint16_t number, Function function) noexcept {
    const std::uint64_t before = hooks_.allocations != nullptr ? hooks_.allocations() : 0;
    if (hooks_.in_part != nullptr) hooks_.in_part->store(number, std::memory_order_relaxed);
    const bool answer = function();
    if (hooks_.in_part != nullptr) hooks_.in_part->store(0, std::memory_order_relaxed);
    if (hooks_.allocations != nullptr && hooks_.allocations() != before) {
      blame(slot, {PartFault::Why::kAllocates, number, 0});
    }
    return answer;
  }

  void judge(Slot& slot, std::uint16_t number, std::int64_t ns) noexcept {
    --slot.closely;
    slot.number_long += ns > kBudget;
    slot.number_very_long += ns > kVeryLong;
    if (slot.number_long < kMostLong && slot.number_very_long < kMostVeryLong) return;
    blame(slot, {PartFault::Why::kTooLong, number, ns});
  }

  void blame(Slot& slot, const PartFault& fault) noexcept {
    slot.at_fault = true;
    if (!at_fault()) fault_ = fault;
  }

  Hooks hooks_;
  std::array<Slot, kTerminations + 16> slots_{};
  PartFault fault_, longest_;
};

}  // namespace realtime
