#include "realtime/walls/self_distance.hpp"

#include <algorithm>
#include <cmath>

namespace realtime {
namespace {

constexpr int kNeighbours = 3;
constexpr double kSame = 1e-6;  // m, of axes that meet: no way leads apart
constexpr double kAlike = 0.02;  // m that an end of an axis may be farther from another and is looked at too
constexpr std::size_t kMost = ArmCapsules::kMost + 4;  // with those that are fixed

struct Segment {
  int link, moves;       // moves: its place among those that do, or -1
  Vector3 centre, half;  // of it, and from there to its end, m
  double radius, length;
};

struct Between {
  double distance;  // m, of the axes
  Vector3 from, to;  // where they are so near
};

// Between two segments (Ericson, Real-Time Collision Detection, 2005, section 5.1.9, with parameters from -1 to 1). No segment
// here is a point.
Between between(const Segment& one, const Segment& two) noexcept {
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
  const Vector3 from = one.centre + s * one.half, to = two.centre + t * two.half;
  return {(to - from).norm(), from, to};
}

Vector3 nearest(const Segment& segment, const Vector3& point) noexcept {
  return segment.centre + std::clamp((point - segment.centre).dot(segment.half) / segment.half.squaredNorm(), -1., 1.) * segment.half;
}

// What of the arm may meet itself, in the same order wherever it is.
struct Segments {
  Segments(const ArmCapsules& arm, const ArmCapsules::Place& place) noexcept {
    for (const auto& capsule : arm.fixed()) add(capsule.link, -1, capsule.a, capsule.b, capsule.radius);
    for (std::size_t i = 0; i < arm.all().size(); ++i) {
      if (i < arm.own() || i >= arm.held()) {
        add(arm.all()[i].link, static_cast<int>(i), place.a[i], place.b[i], arm.all()[i].radius);
      }
    }
  }
  void add(int link, int moves, const Vector3& a, const Vector3& b, double radius) noexcept {
    if (count < kMost) all[count++] = {link, moves, (a + b) / 2, (b - a) / 2, radius, (b - a).norm() / 2};
  }

  std::array<Segment, kMost> all;
  std::size_t count = 0;
};

// Calls visit(one, two, what is between them) for links that are not neighbours and may be nearer than `horizon`, m, which visit()
// may make less.
template <class Visit>
void visit_pairs(const Segments& segments, const double& horizon, Visit visit) noexcept {
  const auto& [all, count] = segments;
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t j = i + 1; j < count; ++j) {
      if (all[j].link - all[i].link < kNeighbours) continue;
      const double far = horizon + all[i].radius + all[j].radius + all[i].length + all[j].length;
      if ((all[i].centre - all[j].centre).squaredNorm() >= far * far) continue;
      visit(all[i], all[j], between(all[i], all[j]));
    }
  }
}

}  // namespace

SelfDistance self_distance(const ArmCapsules& arm, const Vector7& q) noexcept {
  ArmCapsules::Place place;
  arm.place(q, place);
  SelfDistance least;
  visit_pairs(Segments(arm, place), least.distance, [&](const Segment& one, const Segment& two, const Between& axes) {
    const double distance = axes.distance - one.radius - two.radius;
    if (distance < least.distance) least = {distance, {one.link, two.link}};
  });
  return least;
}

std::optional<SelfDistance> comes_nearer(const ArmCapsules& arm, const Vector7& from, const Vector7& q, double clearance,
                                         double rounding) noexcept {
  ArmCapsules::Place there, here;
  arm.place(from, there);
  arm.place(q, here);
  const Segments before(arm, there), now(arm, here);
  SelfDistance least{clearance};
  bool comes = false;
  visit_pairs(now, least.distance, [&](const Segment& one, const Segment& two, const Between& axes) {
    const double radii = one.radius + two.radius, distance = axes.distance - radii;
    if (distance >= least.distance) return;
    const Segment& one_before = before.all[&one - now.all.data()];
    const Segment& two_before = before.all[&two - now.all.data()];
    if (distance >= between(one_before, two_before).distance - radii - rounding) return;
    least = {distance, {one.link, two.link}};
    comes = true;
  });
  return comes ? std::optional(least) : std::nullopt;
}

std::size_t self_contacts(const ArmCapsules& arm, const ArmCapsules::Place& place, double horizon,
                          std::span<SelfContact> out) noexcept {
  std::array<SelfContact, kMost> ends;
  std::size_t count = 0, of_ends = 0;
  const auto by_distance = [](const SelfContact& a, const SelfContact& b) { return a.distance < b.distance; };
  visit_pairs(Segments(arm, place), horizon, [&](const Segment& one, const Segment& two, const Between& axes) {
    const auto add = [&](const Vector3& from, const Vector3& to, std::span<SelfContact> into, std::size_t& of) {
      const double apart = (to - from).norm(), distance = apart - one.radius - two.radius;
      if (distance >= horizon || apart < kSame) return;
      SelfContact* place_of = nullptr;
      if (of < into.size()) {
        place_of = &into[of++];
      } else {
        place_of = &*std::max_element(into.begin(), into.end(), by_distance);
        if (place_of->distance <= distance) return;
      }
      const Vector3 away = (to - from) / apart;
      Vector7 gradient = arm.gradient(place, two.moves, to, away);
      if (one.moves >= 0) gradient -= arm.gradient(place, one.moves, from, away);
      *place_of = {distance, gradient};
    };
    add(axes.from, axes.to, out, count);
    for (const double side : {-1., 1.}) {
      const Vector3 from = one.centre + side * one.half, on_two = nearest(two, from);
      if (from != axes.from && (on_two - from).norm() < axes.distance + kAlike) add(from, on_two, ends, of_ends);
      const Vector3 to = two.centre + side * two.half, on_one = nearest(one, to);
      if (to != axes.to && (to - on_one).norm() < axes.distance + kAlike) add(on_one, to, ends, of_ends);
    }
  });
  for (std::size_t k = 0; k < of_ends && count < out.size(); ++k) out[count++] = ends[k];
  return count;
}

}  // namespace realtime
