#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "bridge/queue.hpp"

namespace realtime {

// A sensor message as the loop sees it: the numbers of its fields in their order, of each repeated field as many as its rule
// says; NaN for what was not given.
struct SensorSample {
  static constexpr std::size_t kMost = 40;  // numbers

  int message = 0;             // which of SensorInput::messages() it is
  std::int64_t sent_ns = 0;    // by the publisher's clock; 0: not said, or of no use: an arm in lockstep
  double lead = 0;             // s after it was sent at which it is meant; of chunks
  bool replaces = false;       // what was sent before and is meant for later
  std::array<double, kMost> values{};
};

// How messages of one topic get into one part: the server room puts, the loop takes; neither waits.
class SensorInput {
 public:
  // Which values make no sense for the part: empty when all do. Called in the server room.
  using Check = std::function<std::string(const SensorSample&)>;
  // Whether a sample tells the part anything: one that does not takes no room. Called in the server room.
  using Tells = bool (*)(const SensorSample&);

  // `messages`: the names of the kinds that it takes, of wire/proto/sensors.proto. `timeout`: s after which the part does without
  // a message; what took longer than that on its way, beside the quickest of its publisher, does not get here. 0: any time.
  SensorInput(std::string topic, std::vector<std::string> messages, double timeout = 0, Check check = nullptr,
              Tells tells = nullptr)
      : topic_(std::move(topic)), messages_(std::move(messages)), timeout_(timeout), check_(std::move(check)), tells_(tells) {}

  const std::string& topic() const { return topic_; }
  const std::vector<std::string>& messages() const { return messages_; }
  double timeout() const { return timeout_; }
  std::string check(const SensorSample& sample) const { return check_ ? check_(sample) : ""; }

  // False when the loop is too far behind.
  bool put(const SensorSample& sample) noexcept { return (tells_ != nullptr && !tells_(sample)) || queue_.push(sample); }
  // The oldest that was not taken yet, or null; release() gives it up.
  const SensorSample* next() const noexcept { return queue_.front(); }
  void release() noexcept { queue_.pop(); }
  // The newest that was not taken yet, into `sample`; false when there is none.
  bool newest(SensorSample& sample) noexcept {
    bool any = false;
    for (const SensorSample* found = next(); found != nullptr; found = next()) {
      sample = *found;
      any = true;
      release();
    }
    return any;
  }

 private:
  std::string topic_;
  std::vector<std::string> messages_;
  double timeout_;
  Check check_;
  Tells tells_;
  bridge::Queue<SensorSample> queue_{256};
};

}  // namespace realtime
