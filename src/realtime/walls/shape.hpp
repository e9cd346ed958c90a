#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>

#include "realtime/reference.hpp"

namespace realtime {

class Mesh;

// A convex body in the base frame O.
struct Shape {
  enum class Kind : std::uint8_t {
    kPlane,     // all below z = 0 of S
    kBox,       // size: half of each edge
    kCylinder,  // about z of S; size: radius, half of its length
    kCapsule,   // about z of S; size: radius, half of its length without the caps. A sphere is one of length 0
    kMesh,
  };
  Kind kind = Kind::kPlane;
  Vector3 size = Vector3::Zero();                             // m
  Eigen::Isometry3d O_T_S = Eigen::Isometry3d::Identity();
  std::shared_ptr<const Mesh> mesh = {};  // of that kind
};

// The radius of a ball about the origin of S that holds the body, m; infinite for a plane.
double reach(const Shape& shape) noexcept;

// How far a point is from a body: negative inside. The normal leads out of it.
struct Distance {
  double distance;  // m
  Vector3 normal;   // in O
};
Distance distance(const Shape& shape, const Vector3& O_point) noexcept;

// The point of a segment from a to b (in O, m) that is nearest to a body, or deepest in it.
struct Nearest : Distance {
  Vector3 point;
};
Nearest nearest(const Shape& shape, const Vector3& a, const Vector3& b) noexcept;

// Whether no point of the segment is nearer to it than `distance`, m. Takes less time than nearest().
bool is_clear(const Shape& shape, const Vector3& a, const Vector3& b, double distance) noexcept;

}  // namespace realtime
