#include "realtime/walls/self_guard.hpp"

#include <algorithm>

namespace realtime {
namespace {

constexpr double kRounding = 1e-9;  // m that is no nearer
constexpr double kRoom = 0.0005;     // m more than the clearance, to which a motion is led that slides along
constexpr double kNear = 0.05;       // m more than that, about which a link comes nearer on such a motion

}  // namespace

double SelfGuard::distance_at(const ArmCapsules& arm, const Vector7& q) noexcept {
  seen_ = q;
  return distance_ = self_distance(arm, q).distance;
}

bool SelfGuard::clear(const ArmCapsules& arm, const Vector7& q, std::span<const Vector7> way, double clearance,
                      bool or_so) noexcept {
  const auto way_between = [&](const Vector7& a, const Vector7& b) { return arm.reach() * (a - b).lpNorm<1>(); };
  double longest = 0;
  for (const Vector7& place : way) longest = std::max(longest, way_between(place, seen_));
  if (distance_ - longest >= clearance) return true;
  distance_at(arm, q);
  for (const Vector7& place : way) {
    if (distance_ - way_between(place, seen_) >= clearance || distance_at(arm, place) >= clearance) continue;
    if (!or_so || comes_nearer(arm, q, place, clearance, kRounding)) return false;
  }
  return true;
}

std::span<const JointBound> SelfGuard::bounds(const ArmCapsules& arm, const Vector7& q, Bounds& out) const noexcept {
  ArmCapsules::Place place;
  arm.place(q, place);
  std::array<SelfContact, kMostContacts> contacts;
  const std::size_t count = self_contacts(arm, place, kSelfClearance + kNear, contacts);
  for (std::size_t k = 0; k < count; ++k) out[k] = {contacts[k].gradient, kSelfClearance + kRoom - contacts[k].distance};
  return {out.data(), count};
}

}  // namespace realtime
