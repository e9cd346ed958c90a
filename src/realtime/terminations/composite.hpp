#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "realtime/part_watch.hpp"
#include "realtime/terminations/termination.hpp"

namespace realtime {

using Terminations = std::vector<std::unique_ptr<Termination>>;

// Several terminations as one. Each of them is asked in every cycle.
class Composite : public Termination {
 public:
  // `numbers` of their kinds, as KindNumbers has them.
  explicit Composite(Terminations parts, std::vector<std::uint16_t> numbers = {})
      : parts_(std::move(parts)), numbers_(std::move(numbers)), places_(parts_.size()) {
    numbers_.resize(parts_.size());
  }

  Channels judges() const noexcept override {
    Channels all = Channels::kNone;
    for (const auto& part : parts_) all = all | part->judges();
    return all;
  }
  bool seeks_goal() const noexcept override {
    return std::all_of(parts_.begin(), parts_.end(), [](const auto& part) { return part->seeks_goal(); });
  }
  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override {
    std::vector<std::shared_ptr<SensorInput>> all;
    for (const auto& part : parts_) {
      for (auto& input : part->sensor_inputs()) all.push_back(std::move(input));
    }
    return all;
  }
  void watched_by(PartWatch& watch) noexcept override {
    watch_ = &watch;
    for (const auto& part : parts_) part->watched_by(watch);
  }
  void start() noexcept override {
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      places_[i] = {};
      const auto start = [&] { parts_[i]->start(); };
      watch_ != nullptr ? watch_->start(places_[i], numbers_[i], start) : start();
    }
  }

 protected:
  std::size_t count(const Cycle& cycle, const Progress& progress) noexcept {
    std::size_t count = 0;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const auto step = [&] { return parts_[i]->step(cycle, progress); };
      count += watch_ != nullptr ? watch_->step(places_[i], numbers_[i], step) : step();
    }
    return count;
  }

  Terminations parts_;

 private:
  std::vector<std::uint16_t> numbers_;
  std::vector<PartWatch::Place> places_;
  PartWatch* watch_ = nullptr;
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
