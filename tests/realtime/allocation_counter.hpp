#pragma once

#include <cstdint>

#include "allocations/allocations.hpp"

namespace testing_tools {

// Counts what the calling thread takes from the heap while it lives.
class AllocationCounter {
 public:
  std::uint64_t count() const { return allocations::of_this_thread() - before_; }  // since construction

 private:
  std::uint64_t before_ = allocations::of_this_thread();
};

}  // namespace testing_tools
