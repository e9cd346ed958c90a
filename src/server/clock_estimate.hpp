#pragma once

#include <algorithm>
#include <cstdint>

#include "frankapy/proto/state.pb.h"

namespace server {

// What a sender's clock is before ours, from the times that it writes on its messages. The message whose way was the shortest
// tells; it counts for less and less, as clocks drift apart. A clock that was set back is believed at once, one that was set
// forward by a second or more when several messages in a row have said so. Times in ns since 1970.
class ClockEstimate {
 public:
  struct Way {
    std::int64_t longer = 0;     // than the shortest, ns
    std::int64_t in_future = 0;  // by how much, ns, where its time is not believed
  };

  // Whether it can be one: others are not taken.
  static bool is_time(std::int64_t ns) { return ns >= 0 && ns <= 4'000'000'000'000'000'000; }  // of this century

  // A message of this time that came `now`. `shortest`: what the sender knows of its way; 0: nothing.
  Way take(std::int64_t sent, std::int64_t now, std::int64_t shortest) {
    const std::int64_t before = sent - now;
    if (!any_ || sent < sent_) {
      before_ = before;
    } else {
      before_ -= std::max<std::int64_t>(now - came_, 0) / kDrift;
    }
    if (before - before_ > kFuture && ++leaps_ <= kLeaps) return {0, before - before_};
    leaps_ = 0;
    before_ = std::max(before_, before);
    shortest_ = std::clamp<std::int64_t>(shortest, 0, kLongestWay);
    sent_ = sent;
    came_ = now;
    any_ = true;
    return {before_ - before, 0};
  }

  // Of its clock before ours.
  std::int64_t ahead_ns() const { return before_ + shortest_; }

  // Once a second: what recordings are told.
  bool is_due(std::int64_t now) {
    if (!any_ || now - told_ < kTellPeriod) return false;
    told_ = now;
    return true;
  }
  void put(frankapy::proto::ClockDifference& out) const {
    out.set_ahead(1e-9 * static_cast<double>(ahead_ns()));
    if (shortest_ > 0) out.set_uncertain(1e-9 * static_cast<double>(shortest_));
  }

 private:
  static constexpr std::int64_t kDrift = 5000;  // a clock goes wrong by less than a 5000th
  static constexpr std::int64_t kFuture = 1'000'000'000, kTellPeriod = 1'000'000'000;
  static constexpr int kLeaps = 10;
  static constexpr std::int64_t kLongestWay = 1'000'000'000;

  bool any_ = false;
  std::int64_t before_ = 0;  // its clock before ours, less the shortest way
  std::int64_t shortest_ = 0, sent_ = 0, came_ = 0, told_ = 0;
  int leaps_ = 0;
};

}  // namespace server
