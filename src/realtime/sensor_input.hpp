#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "bridge/ring.hpp"

namespace realtime {

// A sensor message as the loop sees it: the numbers of its fields in their order, of each repeated field as many as its rule
// says; NaN for what was not given.
struct SensorSample {
  static constexpr std::size_t kMost = 48;  // numbers: of 8 sensors for 6 dimensions

  int message = 0;             // which of SensorInput::messages() it is
  std::int64_t sent_ns = 0;    // by the publisher's clock; 0: not said, or of no use: an arm in lockstep
  double lead = 0;             // s after it was sent at which it is meant; of chunks
  bool replaces = false;       // what was sent before and is meant for later
  std::uint64_t came = 0;      // ms of the robot's clock
  double waited = 0;           // s that it came before the skill began
  std::array<double, kMost> values{};
};

// How messages of one topic get into one part: the server room puts, the loop takes; neither waits. The newest are kept.
class SensorInput {
 public:
  // Which values make no sense for the part: empty when all do. Called in the server room.
  using Check = std::function<std::string(const SensorSample&)>;
  // Whether a sample tells the part anything: one that does not takes no room. Called in the server room.
  using Tells = bool (*)(const SensorSample&);

  // `messages`: the names of the kinds that it takes, of wire/proto/sensors.proto. `timeout`: s after which the part does without
  // a message; what took longer than that on its way, beside the quickest of its publisher, does not get here, and what came longer
  // than that before the skill began is not taken. 0: any time.
  SensorInput(std::string topic, std::vector<std::string> messages, double timeout = 0, Check check = nullptr,
              Tells tells = nullptr)
      : topic_(std::move(topic)), messages_(std::move(messages)), timeout_(timeout), check_(std::move(check)), tells_(tells) {}

  const std::string& topic() const { return topic_; }
  const std::vector<std::string>& messages() const { return messages_; }
  double timeout() const { return timeout_; }
  std::string check(const SensorSample& sample) const { return check_ ? check_(sample) : ""; }

  // False when that overwrote one that was not taken yet: the loop is too far behind, or the skill has not begun.
  bool put(const SensorSample& sample) noexcept {
    if (tells_ != nullptr && !tells_(sample)) return true;
    const bool has_room = ring_.written() - taken_.load(std::memory_order_acquire) < kRoom;
    ring_.push(sample);
    return has_room;
  }
  // The loop's: its skill begins, or is still waited for, at this ms of the robot's clock.
  void begin(std::uint64_t now) noexcept {
    begun_.store(now, std::memory_order_relaxed);
    first_ = reader_.position();
  }
  // It begins anew: what it has taken since is taken again.
  void begin_again() noexcept { reader_ = bridge::RingReader<SensorSample>(ring_, first_); }
  // When that was; 0: it has not.
  std::uint64_t begun() const noexcept { return begun_.load(std::memory_order_relaxed); }
  // The oldest that is still there and was not taken yet, into `sample`; false when there is none.
  bool take(SensorSample& sample) noexcept {
    bool any = false, replaces = false;
    const std::uint64_t begun = this->begun();
    for (SensorSample next; !any && reader_.next(next);) {
      next.waited = begun > next.came ? 1e-3 * static_cast<double>(begun - next.came) : 0;
      any = timeout_ <= 0 || next.waited - next.lead <= timeout_;
      if (!any && (next.lead <= 0 || next.replaces)) outdated_.fetch_add(1, std::memory_order_relaxed);
      replaces |= next.replaces;
      if (!any) continue;
      sample = next;
      sample.replaces = replaces;
    }
    taken_.store(reader_.position(), std::memory_order_release);
    return any;
  }
  // Messages of which that left something out.
  std::uint64_t outdated() const noexcept { return outdated_.load(std::memory_order_relaxed); }
  // The newest that was not taken yet, likewise; the others are given up.
  bool newest(SensorSample& sample) noexcept {
    bool any = false;
    while (take(sample)) any = true;
    return any;
  }

 private:
  std::string topic_;
  std::vector<std::string> messages_;
  double timeout_;
  Check check_;
  Tells tells_;
  static constexpr std::size_t kRoom = 255;  // messages
  bridge::Ring<SensorSample> ring_{kRoom + 1};
  bridge::RingReader<SensorSample> reader_{ring_};
  std::uint64_t first_ = 0;  // of the ring, that was not taken when it began
  std::atomic<std::uint64_t> taken_{0};  // of the ring, from its first
  std::atomic<std::uint64_t> outdated_{0};
  std::atomic<std::uint64_t> begun_{0};  // ms of the robot's clock
};

}  // namespace realtime
