#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "realtime/walls/shape.hpp"

namespace realtime {

// A convex body whose surface is triangles. Made in the server room.
class Mesh {
 public:
  // Its corners in the frame S of the body (m), and for each triangle the numbers of three, from 0 on, counter-clockwise seen from
  // outside. Throws std::invalid_argument where that is not the closed surface of a body which is convex to within 0.1 mm.
  Mesh(const std::vector<Vector3>& corners, std::span<const std::array<std::uint32_t, 3>> triangles);

  // As distance() of a shape, but in S.
  Distance distance(const Vector3& p) const noexcept;
  double reach() const noexcept { return reach_; }

 private:
  struct Plane {
    Vector3 normal;
    double height;  // above the origin, along the normal
  };
  struct Triangle {
    std::array<Vector3, 3> corner, edge, across;  // edge: to the next corner; across: in the plane, out of the triangle
    std::array<int, 3> beyond;                    // the triangle on the other side of each edge
  };
  // The point of a triangle that is nearest to another.
  struct Foot {
    Vector3 away;    // from there to the other, m
    double squared;  // m²
    int edge = -1;   // on which it is; -1: within
    int corner = -1;
  };
  Foot foot(int triangle, const Vector3& p) const noexcept;
  // The foot on what touches that one of this triangle; leads to where it is.
  Foot beside(int& triangle, const Foot& foot, const Vector3& p) const noexcept;

  std::vector<Plane> planes_;  // of the triangles
  std::vector<Triangle> triangles_;
  double reach_ = 0;
};

}  // namespace realtime
