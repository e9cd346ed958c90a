#pragma once

#include <span>

#include "realtime/walls/past_bounds.hpp"
#include "realtime/walls/self_distance.hpp"

namespace realtime {

// Keeps an arm from itself, as WallGuard does from walls: the way on which it would come to rest if it braked from there is looked
// at in each cycle, where it may have come near at all.
class SelfGuard {
 public:
  // Whether the arm keeps that clearance (m) on that way of the joints (rad) from q on; `or_so`: or links that are nearer at q come
  // no nearer.
  bool clear(const ArmCapsules& arm, const Vector7& q, std::span<const Vector7> way, double clearance, bool or_so = true) noexcept;

  // What keeps a change of the joints, from q on, kSelfClearance between all that is near to each other there.
  static constexpr int kMostContacts = 16;
  using Bounds = std::array<JointBound, kMostContacts>;
  std::span<const JointBound> bounds(const ArmCapsules& arm, const Vector7& q, Bounds& out) const noexcept;

 private:
  double distance_at(const ArmCapsules& arm, const Vector7& q) noexcept;

  // A place that was looked at, and how near it is there: elsewhere that is less by what the arm moves between, at most.
  Vector7 seen_ = Vector7::Zero();
  double distance_ = -1e9;  // m; none yet
};

}  // namespace realtime
