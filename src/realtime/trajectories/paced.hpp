#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "realtime/slow.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// How fast a path is gone along: its own time, s, by the time that passes, s. Between the places a polynomial of fifth degree, so
// that velocity and acceleration of what moves along it are continuous.
struct Pace {
  struct Place {
    double time, path;    // s
    double rate, change;  // of the path's time, and how that changes; 1/s
  };
  std::vector<Place> places;  // from 0 to both ends, at least two
};

// Another trajectory, gone along at that pace: slower where limits of the arm ask for it, on the same way. If it cannot begin as
// fast as the trajectory itself, it begins at rest, so that a fast motion which it takes over from is braked by the limiter and
// not on the slow clock, which would lead it astray.
class Paced : public TrajectoryGenerator {
 public:
  // `pace` is for the trajectory's duration as it is now; one that starts elsewhere is stretched alike.
  Paced(std::unique_ptr<TrajectoryGenerator> trajectory, Pace pace) : trajectory_(std::move(trajectory)), pace_(std::move(pace)) {}

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return trajectory_->sensor_inputs(); }
  Channels fills() const noexcept override { return trajectory_->fills(); }

  void start(const Reference& from) noexcept override {
    Reference begin = from;
    if (pace_.places.front().rate < 1) slow(begin, 0, 0);
    trajectory_->start(begin);
    scale_ = trajectory_->duration() / pace_.places.back().path;
  }

  bool step(const Cycle& cycle, double time, Reference& reference) noexcept override {
    const auto after = std::upper_bound(pace_.places.begin() + 1, pace_.places.end(), time / scale_,
                                        [](double t, const Pace::Place& place) { return t < place.time; });
    if (after == pace_.places.end()) return trajectory_->step(cycle, trajectory_->duration(), reference);
    const Pace::Place now = between(*(after - 1), *after, time / scale_);
    const bool over = trajectory_->step(cycle, scale_ * now.path, reference);
    slow(reference, now.rate, now.change / scale_);
    return over;
  }

  const Reference& goal() const noexcept override { return trajectory_->goal(); }
  bool shortened() const noexcept override { return trajectory_->shortened(); }
  void held_back(const Reference& reference) noexcept override { trajectory_->held_back(reference); }
  bool limited() const noexcept override { return trajectory_->limited(); }
  double duration() const noexcept override { return scale_ * pace_.places.back().time; }
  double stretch() const noexcept override { return pace_.places.back().time / pace_.places.back().path * trajectory_->stretch(); }

 private:
  static Pace::Place between(const Pace::Place& a, const Pace::Place& b, double time) noexcept {
    const double h = b.time - a.time, t = std::max(time - a.time, 0.);
    // What is left at b of a motion with constant acceleration from a.
    const double x = b.path - a.path - h * (a.rate + h / 2 * a.change), v = b.rate - a.rate - h * a.change, w = b.change - a.change;
    const double c3 = (10 * x / h - 4 * v + h * w / 2) / (h * h), c4 = (-15 * x / h + 7 * v - h * w) / (h * h * h),
                 c5 = (6 * x / h - 3 * v + h * w / 2) / (h * h * h * h);
    return {time, a.path + t * (a.rate + t * (a.change / 2 + t * (c3 + t * (c4 + t * c5)))),
            a.rate + t * (a.change + t * (3 * c3 + t * (4 * c4 + t * 5 * c5))),
            a.change + t * (6 * c3 + t * (12 * c4 + t * 20 * c5))};
  }

  std::unique_ptr<TrajectoryGenerator> trajectory_;
  Pace pace_;
  double scale_ = 1;
};

}  // namespace realtime
