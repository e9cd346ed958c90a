#include "realtime/walls/shape.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "realtime/walls/mesh.hpp"

namespace realtime {
namespace {

constexpr int kMostTangents = 30;
constexpr double kClose = 1e-10;  // m from the least distance

// Of the difference q = |p| - size, by axis: a box, or a cylinder seen from the side.
template <int N>
double outside(const Eigen::Matrix<double, N, 1>& q, Eigen::Matrix<double, N, 1>& normal) {
  int axis;
  const double most = q.maxCoeff(&axis);
  if (most <= 0) {
    normal.setZero();
    normal[axis] = 1;
    return most;
  }
  normal = q.cwiseMax(0);
  const double length = normal.norm();
  normal /= length;
  return length;
}

Distance in_own_frame(const Shape& shape, const Vector3& p) {
  switch (shape.kind) {
    case Shape::Kind::kPlane: break;
    case Shape::Kind::kBox: {
      Vector3 normal;
      const double d = outside<3>(p.cwiseAbs() - shape.size, normal);
      for (int i = 0; i < 3; ++i) normal[i] = std::copysign(normal[i], p[i]);
      return {d, normal};
    }
    case Shape::Kind::kCylinder: {
      const double r = std::hypot(p[0], p[1]);
      Eigen::Vector2d normal;
      const double d = outside<2>({r - shape.size[0], std::abs(p[2]) - shape.size[1]}, normal);
      const Eigen::Vector2d radial = r > 0 ? Eigen::Vector2d(p.head<2>() / r) : Eigen::Vector2d::UnitX();
      return {d, {normal[0] * radial[0], normal[0] * radial[1], std::copysign(normal[1], p[2])}};
    }
    case Shape::Kind::kCapsule: {
      const Vector3 from_axis = p - std::clamp(p[2], -shape.size[1], shape.size[1]) * Vector3::UnitZ();
      const double r = from_axis.norm();
      return {r - shape.size[0], r > 0 ? Vector3(from_axis / r) : Vector3::UnitX()};
    }
    case Shape::Kind::kMesh: return shape.mesh->distance(p);
  }
  return {p[2], Vector3::UnitZ()};
}

// The place on a segment from p on, 0 to 1, that is nearest to a body. Along it the distance from a convex body is convex and so
// lies above its tangents: where those on either side of the least one meet is looked at next, until that is as low as what was
// found, or `enough(found, least)`, both in m, says that it is known well enough.
template <class Enough>
std::pair<double, Distance> nearest_place(const Shape& shape, const Vector3& p, const Vector3& way, const Enough& enough) {
  struct Place {
    double at, slope;
    Distance own;
  };
  const auto look = [&](double at) {
    const Distance own = in_own_frame(shape, p + at * way);
    return Place{at, own.normal.dot(way), own};
  };
  Place low = look(0);
  if (low.slope >= 0) return {low.at, low.own};
  Place high = look(1);
  if (high.slope <= 0) return {high.at, high.own};
  Place best = low.own.distance < high.own.distance ? low : high;
  for (int k = 0; k < kMostTangents; ++k) {
    const double width = high.at - low.at;
    const double step = (low.own.distance - high.own.distance + high.slope * width) / (high.slope - low.slope);
    const double least = low.own.distance + low.slope * step;
    if (best.own.distance - least < kClose || enough(best.own.distance, least)) break;
    const Place next = look(low.at + std::clamp(step, 0., width));
    if (next.own.distance < best.own.distance) best = next;
    if (next.slope == 0) break;
    (next.slope < 0 ? low : high) = next;
  }
  return {best.at, best.own};
}

}  // namespace

double reach(const Shape& shape) noexcept {
  switch (shape.kind) {
    case Shape::Kind::kPlane: break;
    case Shape::Kind::kBox: return shape.size.norm();
    case Shape::Kind::kCylinder: return shape.size.head<2>().norm();
    case Shape::Kind::kCapsule: return shape.size[0] + shape.size[1];
    case Shape::Kind::kMesh: return shape.mesh->reach();
  }
  return std::numeric_limits<double>::infinity();
}

Distance distance(const Shape& shape, const Vector3& O_point) noexcept {
  const auto& R = shape.O_T_S.linear();
  const Distance own = in_own_frame(shape, R.transpose() * (O_point - shape.O_T_S.translation()));
  return {own.distance, R * own.normal};
}

Nearest nearest(const Shape& shape, const Vector3& a, const Vector3& b) noexcept {
  const auto& R = shape.O_T_S.linear();
  const Vector3 p = R.transpose() * (a - shape.O_T_S.translation()), way = R.transpose() * (b - a);
  const auto [at, own] = nearest_place(shape, p, way, [](double, double) { return false; });
  return {{own.distance, R * own.normal}, a + at * (b - a)};
}

bool is_clear(const Shape& shape, const Vector3& a, const Vector3& b, double distance) noexcept {
  const auto& R = shape.O_T_S.linear();
  const Vector3 p = R.transpose() * (a - shape.O_T_S.translation()), way = R.transpose() * (b - a);
  const auto known = [&](double found, double least) { return found < distance || least >= distance; };
  return nearest_place(shape, p, way, known).second.distance >= distance;
}

}  // namespace realtime
