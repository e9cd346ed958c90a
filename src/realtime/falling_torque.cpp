#include "realtime/falling_torque.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/power_taken.hpp"
#include "realtime/tick.hpp"

namespace realtime {
namespace {

constexpr int kHalvings = 7;         // of the way that is looked for
constexpr int kPlaces = 3;           // of a fall after its beginning, where it is looked at what the joints take
constexpr double kSame = 1e-9;       // rad/s, m/s, W
constexpr double kUnforeseen = 1.5;  // times the change of velocity that M now tells

}  // namespace

FallingTorque::FallingTorque(const Model& model, const Vector7& dq, const Matrix7& mobility, const Vector7& rest,
                             const Vector7& gravity, const Vector7& rate, const Vector7& sent, const WallGuard& walls) noexcept
    : model_(model), mobility_(mobility), rest_(rest), gravity_(gravity), rate_(rate), sent_(sent), walls_(walls), dq_(dq) {
  dq_.noalias() += kTick * (mobility * (sent - rest));
}

FallingTorque::Fall FallingTorque::fall(const Vector7& tau, const Vector7& to, const Vector3& turning) const noexcept {
  const Vector7 u = tau - to, ddq = kUnforeseen * (mobility_ * u);
  const double falls = time(u) + kTick;  // it acts for a cycle before it does
  Fall fall;
  fall.dq = dq_ + falls / 2 * ddq;
  const auto J = model_.jacobian().topRows<3>();
  fall.tool = std::max((J * dq_).norm(), (J * fall.dq + falls * turning).norm());
  // Of the share y that is left of u: y (p + (1 - y²) e / 2), with p what u does at once and e what all of the fall would add.
  const double p = u.dot(dq_), e = falls * u.dot(ddq), sum = 2 * p + e;
  const double most = p >= e ? p : sum > 0 ? sum * std::sqrt(sum / (3 * e)) / 3 : 0;
  fall.power = std::max(most, 0.) + std::max(to.dot(dq_), to.dot(fall.dq));
  fall.taken = 0;
  for (int k = 0; k <= kPlaces; ++k) {
    const double y = 1 - static_cast<double>(k) / kPlaces;
    fall.taken = std::max(fall.taken, power_taken(to + y * u + gravity_, dq_ + (1 - y * y) * falls / 2 * ddq));
  }
  fall.to_walls = walls_.too_fast(dq_, mobility_, rate_, tau - rest_);
  return fall;
}

bool FallingTorque::Fall::keeps(const SpeedBounds& bounds) const noexcept {
  return (dq.array() <= bounds.dq_max.array()).all() && (dq.array() >= bounds.dq_min.array()).all() && tool <= bounds.tool &&
         power <= bounds.power && taken <= bounds.taken && to_walls <= bounds.to_walls;
}

bool FallingTorque::keeps(const SpeedBounds& bounds, const Vector7& tau) const noexcept {
  return fall(tau, rest_, model_.dJ_dq().head<3>()).keeps(bounds);
}

void FallingTorque::hold(const SpeedBounds& bounds, const Vector7& goal, Vector7& tau) const noexcept {
  const Vector7 to_goal = goal - sent_;
  const Vector7 back = sent_ + to_goal * std::min(kTick / std::max(time(to_goal), kTick), 1.), way = tau - back;
  const Fall least = fall(back, goal, Vector3::Zero());
  const SpeedBounds no_farther{bounds.dq_min.cwiseMin(least.dq).array() - kSame, bounds.dq_max.cwiseMax(least.dq).array() + kSame,
                               std::max(bounds.tool, least.tool) + kSame, std::max(bounds.power, least.power) + kSame,
                               std::max(bounds.taken, least.taken) + kSame, std::max(bounds.to_walls, least.to_walls) + kSame};
  double share = 0;
  for (int i = 0; i < kHalvings; ++i) {
    const double more = i == 0 ? 1 : share + std::ldexp(1., -i);
    if (fall(back + more * way, goal, Vector3::Zero()).keeps(no_farther)) share = more;
    if (share == 1) return;
  }
  tau = back + share * way;
}

}  // namespace realtime
