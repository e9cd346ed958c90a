#include "realtime/walls/shape.hpp"

#include <algorithm>
#include <cmath>

namespace realtime {
namespace {

// Along a segment the distance from a convex body is convex: its least is found by halving.
constexpr int kHalvings = 20;

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
  }
  return {p[2], Vector3::UnitZ()};
}

}  // namespace

Distance distance(const Shape& shape, const Vector3& O_point) noexcept {
  const auto& R = shape.O_T_S.linear();
  const Distance own = in_own_frame(shape, R.transpose() * (O_point - shape.O_T_S.translation()));
  return {own.distance, R * own.normal};
}

Nearest nearest(const Shape& shape, const Vector3& a, const Vector3& b) noexcept {
  const auto& R = shape.O_T_S.linear();
  const Vector3 p = R.transpose() * (a - shape.O_T_S.translation()), way = R.transpose() * (b - a);
  double low = 0, high = 1, at = 0;
  Distance own = in_own_frame(shape, p);
  if (own.normal.dot(way) < 0) {
    at = 1;
    own = in_own_frame(shape, p + way);
    if (own.normal.dot(way) > 0) {
      for (int k = 0; k < kHalvings; ++k) {
        at = (low + high) / 2;
        own = in_own_frame(shape, p + at * way);
        (own.normal.dot(way) < 0 ? low : high) = at;
      }
    }
  }
  return {{own.distance, R * own.normal}, a + at * (b - a)};
}

}  // namespace realtime
