#include "realtime/joint_barrier.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/joint_range.hpp"

namespace realtime {
namespace {

constexpr double kSpeedShare = 0.85;   // of the allowed speed, that a joint may come to
constexpr double kBrakeShare = 0.4;    // of the acceleration limit that braking counts on
constexpr double kApproach = 20;       // 1/s, at which a joint may come near to its greatest speed, and falls back to it
constexpr double kFarFrom = 0.4;       // of that speed: below it nothing is looked at
constexpr double kEndMargin = 0.02;    // rad before the end of the range where pushing back begins at the latest
constexpr double kFullPush = 0.03;     // rad, over which pushing back rises to the greatest torque
constexpr double kReturnSpeed = 0.2;   // rad/s of a joint that comes back to its reference from
constexpr double kReturnFrom = 0.1;    // rad, until it is nearer than
constexpr double kReturned = 0.01;     // rad
constexpr double kReturnShare = 1.3;   // of the reference's own speed, if that is more
constexpr double kAhead = 0.01;        // s, in which the fall of the allowed speed is looked at
constexpr int kPasses = 4;             // through the joints, as each moves the others
constexpr int kPassesOfAll = 12;       // where they are not alone

}  // namespace

JointBarrier::JointBarrier(const models::Limits& limits) : limits_(limits), asked_(limits.dq_max) {
  for (int i = 0; i < models::kJoints; ++i) {
    end_min_[i] = std::max(rest_min(limits, i), limits.q_min[i] + kEndMargin);
    end_max_[i] = std::min(rest_max(limits, i), limits.q_max[i] - kEndMargin);
  }
}

bool JointBarrier::add(const Vector7& q, const Vector7& dq, const Matrix7& mobility, const Vector7& c,
                       const Lead& lead, Vector7& tau_J_d, Brake* other) noexcept {
  returns_ = lead.away > (returns_ ? kReturned : kReturnFrom);
  // Along the way that each joint moves: its greatest speed here, and the acceleration that keeps to it.
  Vector7 sign, most;
  bool near = other != nullptr, needed = false;
  for (int i = 0; i < models::kJoints; ++i) {
    sign[i] = dq[i] < 0 ? -1 : 1;
    const double speed = std::abs(dq[i]);
    const double brake = kBrakeShare * limits_.ddq_max[i];
    const double asked = kSpeedShare * asked_[i];
    const auto brakable = [&](double way) { return std::sqrt(2 * brake * std::max(way, 0.)); };
    const auto allowed = [&](double at) {
      return kSpeedShare * (sign[i] < 0 ? -limits_.dq_lower(i, at) : limits_.dq_upper(i, at));
    };
    dq_min_[i] = -std::min({-kSpeedShare * limits_.dq_lower(i, q[i]), brakable(q[i] - end_min_[i]), asked});
    dq_max_[i] = std::min({kSpeedShare * limits_.dq_upper(i, q[i]), brakable(end_max_[i] - q[i]), asked});

    const double before_end = brakable(dq[i] < 0 ? q[i] - end_min_[i] : end_max_[i] - q[i]);
    const double here = allowed(q[i]), falls = (here - allowed(q[i] + kAhead * dq[i])) / kAhead;
    most[i] = kApproach * (here - speed) - falls;
    if (before_end < here) {
      most[i] = std::min(most[i], kApproach * (before_end - speed) - brake * std::min(speed / std::max(before_end, 1e-3), 1.));
    }
    // One that has just become too fast, as less is allowed, has time for it.
    most[i] = std::min(most[i], std::max(kApproach * (asked - speed), -brake));
    double greatest = std::min({here, before_end, asked});
    if (returns_ && sign[i] * (tau_J_d[i] - c[i]) > 0) {
      const double slow = std::max(kReturnSpeed, kReturnShare * std::abs(lead.dq[i]));
      most[i] = std::min(most[i], kApproach * (slow - speed));
      greatest = std::min(greatest, slow);
    }
    most[i] -= std::max(sign[i] * lead.pushed[i], 0.);
    near |= speed > kFarFrom * greatest;

    const double beyond = q[i] > end_max_[i] ? q[i] - end_max_[i] : std::min(q[i] - end_min_[i], 0.);
    needed |= beyond != 0;
    tau_J_d[i] -= limits_.tau_max[i] / kFullPush * beyond;
  }
  if (!near) return needed;

  Vector7 ddq = mobility * (tau_J_d - c);
  Vector7 added = Vector7::Zero();
  const Vector7 response = other != nullptr ? Vector7(mobility * other->gradient) : Vector7::Zero();
  for (int pass = 0; pass < (other != nullptr ? kPassesOfAll : kPasses); ++pass) {
    if (other != nullptr) {
      const double excess = other->gradient.dot(ddq) - other->most;
      const double force = std::max(other->force + excess / other->gradient.dot(response), 0.);
      ddq -= (force - other->force) * response;
      other->force = force;
    }
    for (int i = 0; i < models::kJoints; ++i) {
      // What an earlier pass has added too much is taken back.
      const double excess = sign[i] * ddq[i] - most[i];
      const double sum = std::clamp(sign[i] * added[i] - excess / mobility(i, i), -2 * limits_.tau_max[i], 0.);
      const double change = sign[i] * sum - added[i];
      added[i] += change;
      ddq += change * mobility.col(i);
    }
  }
  tau_J_d += added;
  if (other != nullptr) tau_J_d -= other->force * other->gradient;
  return needed || !added.isZero(1e-9);
}

}  // namespace realtime
