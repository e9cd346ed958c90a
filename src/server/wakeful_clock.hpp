#pragma once

#include <algorithm>
#include <chrono>

namespace server {

// Time as the thread that asks again and again has lived it: of a pause longer than `longest` only that much counts. So a
// computer that stood still, or had no time for this thread either, makes nobody look as if it hung.
class WakefulClock {
 public:
  using Steady = std::chrono::steady_clock;

  explicit WakefulClock(Steady::duration longest) : longest_(longest) {}

  Steady::duration now() {
    const auto asked = Steady::now();
    lived_ += std::min(asked - asked_, longest_);
    asked_ = asked;
    return lived_;
  }

 private:
  const Steady::duration longest_;
  Steady::time_point asked_ = Steady::now();
  Steady::duration lived_{};
};

}  // namespace server
