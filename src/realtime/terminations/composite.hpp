#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "realtime/terminations/termination.hpp"

namespace realtime {

using Terminations = std::vector<std::unique_ptr<Termination>>;

// Several terminations as one. Each of them is asked in every cycle.
class Composite : public Termination {
 public:
  explicit Composite(Terminations parts) : parts_(std::move(parts)) {}

  Channels judges() const noexcept override {
    Channels all = Channels::kNone;
    for (const auto& part : parts_) all = all | part->judges();
    return all;
  }
  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override {
    std::vector<std::shared_ptr<SensorInput>> all;
    for (const auto& part : parts_) {
      for (auto& input : part->sensor_inputs()) all.push_back(std::move(input));
    }
    return all;
  }
  void start() noexcept override {
    for (const auto& part : parts_) part->start();
  }

 protected:
  std::size_t count(const Cycle& cycle, const Progress& progress) noexcept {
    return static_cast<std::size_t>(std::count_if(
        parts_.begin(), parts_.end(), [&](const auto& part) { return part->step(cycle, progress); }));
  }

  Terminations parts_;
};

// Ends when one of them would.
class AnyOf : public Composite {
 public:
  using Composite::Composite;
  bool step(const Cycle& cycle, const Progress& progress) noexcept override { return count(cycle, progress) > 0; }
};

// Ends when all of them would, in the same cycle; as softly as one of them does.
class AllOf : public Composite {
 public:
  using Composite::Composite;
  SoftEnding* then() noexcept override {
    for (const auto& part : parts_) {
      if (SoftEnding* then = part->then()) return then;
    }
    return nullptr;
  }
  bool step(const Cycle& cycle, const Progress& progress) noexcept override {
    return count(cycle, progress) == parts_.size();
  }
};

}  // namespace realtime
