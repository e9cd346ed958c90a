#pragma once

#include <cstdint>

namespace allocations {

// How often the calling thread has taken memory from the heap. A program that links this has its own malloc and kin, which
// count and ask glibc's. Sanitizers bring their own heap: nothing is counted then, and kCounts says so.
std::uint64_t of_this_thread() noexcept;

extern const bool kCounts;

}  // namespace allocations
