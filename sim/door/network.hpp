#pragma once

#include <cstdint>
#include <optional>
#include <random>

namespace sim {

// What a bad network does to the datagrams of one arm: loses or delays some of them, drawn from a seed.
class Network {
 public:
  struct Way {
    double loss = 0;         // share
    double delayed = 0;      // share of those that are not lost
    std::int64_t delay = 0;  // ns
  };

  void set(const Way& to_arm, const Way& from_arm, std::uint64_t seed);

  // What becomes of the next datagram: its delay (ns), or empty: it is lost.
  std::optional<std::int64_t> to_arm() { return fate(to_arm_); }
  std::optional<std::int64_t> from_arm() { return fate(from_arm_); }

 private:
  std::optional<std::int64_t> fate(const Way& way);

  Way to_arm_, from_arm_;
  std::mt19937_64 random_;
};

}  // namespace sim
