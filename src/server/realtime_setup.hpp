#pragma once

#include <optional>
#include <string>
#include <vector>

namespace server {

// What of this computer and its permissions matters to a loop that must answer within 1 ms.
struct RealtimeReport {
  std::string kernel;             // release, and whether it is PREEMPT_RT
  std::string scheduling;         // of the loop's thread
  std::string memory;             // locked or not
  std::vector<std::string> deficiencies;  // each with its remedy
};

// Locks the process' memory, now and later, where that is permitted and will not make allocations fail.
// Returns what was found of kernel, memory and processor clock.
RealtimeReport prepare_process();

// To be called by the loop's thread, number `index` of this computer: SCHED_FIFO where `realtime`; the processor that is
// named, or else an isolated one of its own where there are any (elsewhere the kernel chooses better); a stack that is in
// memory. Adds to the report what came of it.
void prepare_thread(int index, std::optional<int> processor, bool realtime, RealtimeReport& report);

// While it lives, the calling thread, and those that it makes, go before the ordinary ones of this computer (nice -10), where that
// is permitted: a stop on its way to the loop's door should not wait for those who compute. Not real-time, so that a flood of
// requests takes nothing from the network.
class Preferred {
 public:
  Preferred();
  ~Preferred();
  Preferred(const Preferred&) = delete;

 private:
  int nice_;
};

// Numbers in a list of the kernel's form "2-3,7".
std::vector<int> parse_cpu_list(const std::string& text);

}  // namespace server
