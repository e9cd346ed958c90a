#pragma once

#include <cstdint>

namespace testing_tools {

// Counts what the calling thread takes from the heap while it lives; malloc and its kin are replaced in
// every program that links allocation_counter.cpp. Sanitizers bring their own heap: nothing is counted
// then, and kCountsAllocations says so.
class AllocationCounter {
 public:
  AllocationCounter();

  std::uint64_t count() const;  // since construction

 private:
  std::uint64_t before_;
};

extern const bool kCountsAllocations;

}  // namespace testing_tools
