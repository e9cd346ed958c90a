#include "realtime/walls/self_distance.hpp"

#include <algorithm>
#include <cmath>

namespace realtime {
namespace {

constexpr int kNeighbours = 3;
constexpr std::size_t kMost = ArmCapsules::kMost + 4;  // with those that are fixed

struct Segment {
  int link;
  Vector3 centre, half;  // of it, and from there to its end, m
  double radius, length;
};

// Between two segments (Ericson, Real-Time Collision Detection, 2005, section 5.1.9, with parameters from -1 to 1). No segment
// here is a point.
double between(const Segment& one, const Segment& two) noexcept {
  const Vector3 r = one.centre - two.centre;
  const double a = one.half.squaredNorm(), b = one.half.dot(two.half), e = two.half.squaredNorm();
  const double c = one.half.dot(r), f = two.half.dot(r);
  const double denominator = a * e - b * b;
  double s = denominator > 1e-12 * a * e ? std::clamp((b * f - c * e) / denominator, -1., 1.) : 0;
  double t = (b * s + f) / e;
  if (std::abs(t) > 1) {
    t = std::clamp(t, -1., 1.);
    s = std::clamp((b * t - c) / a, -1., 1.);
  }
  return (r + s * one.half - t * two.half).norm();
}

}  // namespace

SelfDistance self_distance(const ArmCapsules& arm, const Vector7& q) noexcept {
  ArmCapsules::Place place;
  arm.place(q, place);
  std::array<Segment, kMost> all;
  std::size_t count = 0;
  const auto add = [&](int link, const Vector3& a, const Vector3& b, double radius) {
    if (count < kMost) all[count++] = {link, (a + b) / 2, (b - a) / 2, radius, (b - a).norm() / 2};
  };
  for (const auto& capsule : arm.fixed()) add(capsule.link, capsule.a, capsule.b, capsule.radius);
  for (std::size_t i = 0; i < arm.own(); ++i) add(arm.all()[i].link, place.a[i], place.b[i], arm.all()[i].radius);
  SelfDistance least;
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t j = i + 1; j < count; ++j) {
      if (all[j].link - all[i].link < kNeighbours) continue;
      const double radii = all[i].radius + all[j].radius, far = least.distance + radii + all[i].length + all[j].length;
      if ((all[i].centre - all[j].centre).squaredNorm() >= far * far) continue;
      const double distance = between(all[i], all[j]) - radii;
      if (distance < least.distance) least = {distance, {all[i].link, all[j].link}};
    }
  }
  return least;
}

}  // namespace realtime
