#pragma once

#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <ctime>
#include <utility>

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

  // Places of parts; terminations have one each, and those within others one of their own.
  static constexpr int kTrajectory = 0, kController = 1, kTerminations = 2;
  struct Place {
    int closely = 0;  // steps that are still measured by processor time
    int number_long = 0, number_very_long = 0;  // of them
    bool at_fault = false;
  };

  explicit PartWatch(const Hooks& hooks) : hooks_(hooks) {}

  // Other parts from now on, none of them at fault.
  void reset() noexcept {
    places_.fill({});
    fault_ = longest_ = {};
  }

  // Of the parts since reset(): the first fault; and the longest step in wall time, whatever made it so long.
  const PartFault& fault() const noexcept { return fault_; }
  const PartFault& longest() const noexcept { return longest_; }
  bool at_fault() const noexcept { return fault_.why != PartFault::Why::kNone; }
  bool at_fault(int role) const noexcept { return place(role).at_fault; }

  void not_finite(int role, std::uint16_t number) noexcept { blame(place(role), {PartFault::Why::kNotFinite, number, 0}); }

  // Calls a part's step() and gives back its answer.
  template <class Step>
  bool step(int role, std::uint16_t number, Step step) noexcept {
    return this->step(place(role), number, step);
  }
  template <class Step>
  bool step(Place& place, std::uint16_t number, Step step) noexcept {
    const bool closely = place.closely > 0;
    const std::int64_t used = closely ? now(CLOCK_THREAD_CPUTIME_ID) : 0;
    const long waits = closely ? this->waits() : 0;
    bool answer = false;
    const std::int64_t wall = timed(number, [&] { answer = call(place, number, step); });
    if (closely) {
      const bool never_waits = wall > kBudget && this->waits() == waits;
      judge(place, number, never_waits ? std::min(wall, now(CLOCK_THREAD_CPUTIME_ID) - used) : wall);
    } else if (wall > kBudget) {
      place.closely = kWindow;
      place.number_long = place.number_very_long = 0;
    }
    return answer;
  }

  // Calls its start(), which may take longer.
  template <class Start>
  void start(int role, std::uint16_t number, Start start) noexcept {
    this->start(place(role), number, start);
  }
  template <class Start>
  void start(Place& place, std::uint16_t number, Start start) noexcept {
    timed(number, [&] { call(place, number, [&] { return start(), true; }); });
  }

  // Asks a part what it knows of itself.
  template <class Function>
  decltype(auto) ask(std::uint16_t number, Function function) const noexcept {
    const Within within(hooks_.in_part, number);
    return function();
  }

 private:
  // Says meanwhile that the loop is in that part.
  class Within {
   public:
    Within(std::atomic<std::uint32_t>* in_part, std::uint16_t number) noexcept
        : in_part_(in_part), around_(in_part != nullptr ? in_part->load(std::memory_order_relaxed) : 0) {
      if (in_part != nullptr) in_part->store(number, std::memory_order_relaxed);
    }
    ~Within() {
      if (in_part_ != nullptr) in_part_->store(around_, std::memory_order_relaxed);
    }
    Within(const Within&) = delete;

   private:
    std::atomic<std::uint32_t>* const in_part_;
    const std::uint32_t around_;
  };

  // How often this thread has given its processor away of itself.
  static long waits() noexcept {
    rusage used;
    return ::getrusage(RUSAGE_THREAD, &used) == 0 ? used.ru_nvcsw : 0;
  }

  // Returns how long it took beside the parts within it, ns.
  template <class Function>
  std::int64_t timed(std::uint16_t number, Function function) noexcept {
    const std::int64_t before = std::exchange(within_, 0);
    const std::int64_t began = now(CLOCK_MONOTONIC);
    function();
    const std::int64_t wall = now(CLOCK_MONOTONIC) - began, own = wall - within_;
    within_ = before + wall;
    if (own > longest_.ns) longest_ = {PartFault::Why::kTooLong, number, own};
    return own;
  }

  static std::int64_t now(clockid_t clock) noexcept {
    timespec now;
    ::clock_gettime(clock, &now);
    return now.tv_sec * 1'000'000'000ll + now.tv_nsec;
  }

  Place& place(int role) noexcept { return places_[std::min<std::size_t>(role, places_.size() - 1)]; }
  const Place& place(int role) const noexcept { return places_[std::min<std::size_t>(role, places_.size() - 1)]; }

  template <class Function>
  bool call(Place& place, std::uint16_t number, Function function) noexcept {
    const std::uint64_t before = hooks_.allocations != nullptr ? hooks_.allocations() : 0;
    const bool answer = ask(number, function);
    if (hooks_.allocations != nullptr && hooks_.allocations() != before) {
      blame(place, {PartFault::Why::kAllocates, number, 0});
    }
    return answer;
  }

  void judge(Place& place, std::uint16_t number, std::int64_t ns) noexcept {
    --place.closely;
    place.number_long += ns > kBudget;
    place.number_very_long += ns > kVeryLong;
    if (place.number_long < kMostLong && place.number_very_long < kMostVeryLong) return;
    blame(place, {PartFault::Why::kTooLong, number, ns});
  }

  void blame(Place& place, const PartFault& fault) noexcept {
    place.at_fault = true;
    if (!at_fault()) fault_ = fault;
  }

  Hooks hooks_;
  std::array<Place, kTerminations + 16> places_{};
  std::int64_t within_ = 0;  // ns, of parts within the one that is called
  PartFault fault_, longest_;
};

}  // namespace realtime
