#pragma once

#include <algorithm>

#include "realtime/cycle.hpp"
#include "realtime/rotation.hpp"

namespace realtime {

// How far EE may go from where a law took over. Over the last tenth of the way what the law exerts fades to nothing, and a
// damping that slows every joint by 50 1/s takes its place, so that an arm which was pushed does not fly on.
class MotionCap {
 public:
  // m and rad; 0: no cap.
  MotionCap(double max_translation, double max_rotation) : max_translation_(max_translation), max_rotation_(max_rotation) {}

  void start(const Cycle& cycle) noexcept { start_ = cycle.O_T_EE; }

  // Share of what the law exerts, 1 to 0.
  double share(const Cycle& cycle) const noexcept {
    const double moved = (cycle.O_T_EE.translation() - start_.translation()).norm();
    const double turned = log(Eigen::Quaterniond(cycle.O_T_EE.linear() * start_.linear().transpose())).norm();
    return std::min(left(moved, max_translation_), left(turned, max_rotation_));
  }

  // N m, for that share.
  Vector7 damping(const Cycle& cycle, double share) const noexcept {
    constexpr double kRate = 50;  // 1/s
    return (share - 1) * kRate * (cycle.model.mass() * cycle.dq);
  }

 private:
  static double left(double way, double most) noexcept {
    return most > 0 ? std::clamp((most - way) / (0.1 * most), 0.0, 1.0) : 1;
  }

  double max_translation_, max_rotation_;
  Eigen::Isometry3d start_ = Eigen::Isometry3d::Identity();
};

}  // namespace realtime
