#include "realtime/walls/mesh.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace realtime {
namespace {

constexpr double kConvex = 1e-4;       // m that a corner may lie outside the plane of a triangle: corners are rounded in files
constexpr double kLeastArea = 1e-10;   // m²
constexpr double kLeastVolume = 1e-9;  // m³
constexpr double kRounding = 1e-12;    // m
constexpr int kMostAbout = 128;        // triangles about a corner

template <class... Words>
[[noreturn]] void refuse(const Words&... words) {
  std::ostringstream text;
  text.precision(3);
  (text << ... << words);
  throw std::invalid_argument(text.str());
}

}  // namespace

Mesh::Mesh(const std::vector<Vector3>& corners, std::span<const std::array<std::uint32_t, 3>> triangles) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;  // the triangle of each, from corner to corner
  double volume = 0;
  for (std::size_t k = 0; k < triangles.size(); ++k) {
    Triangle triangle;
    for (int i = 0; i < 3; ++i) {
      const std::uint32_t from = triangles[k][i], to = triangles[k][(i + 1) % 3];
      if (from >= corners.size()) {
        refuse("names corner ", from, " in triangle ", k, ": expected 0 to ", corners.size() - 1);
      }
      if (!edges.emplace(std::pair(from, to), static_cast<int>(k)).second) {
        refuse("has the edge from corner ", from, " to ", to,
               " twice: expected each triangle once, its corners counter-clockwise seen from outside");
      }
      triangle.corner[i] = corners[from];
    }
    for (int i = 0; i < 3; ++i) triangle.edge[i] = triangle.corner[(i + 1) % 3] - triangle.corner[i];
    Plane plane{triangle.edge[0].cross(triangle.edge[1]), 0};
    if (plane.normal.norm() < 2 * kLeastArea) refuse("has no area in triangle ", k, ": leave it out");
    plane.normal.normalize();
    plane.height = plane.normal.dot(triangle.corner[0]);
    for (int i = 0; i < 3; ++i) triangle.across[i] = triangle.edge[i].cross(plane.normal);
    volume += (triangle.corner[0] - corners[0]).dot((triangle.corner[1] - corners[0]).cross(triangle.corner[2] - corners[0])) / 6;
    planes_.push_back(plane);
    triangles_.push_back(triangle);
  }
  for (const auto& [edge, of] : edges) {
    const auto [from, to] = edge;
    const auto other = edges.find({to, from});
    if (other == edges.end()) {
      refuse("is not closed: there is a triangle on one side only of the edge from corner ", from, " to ", to);
    }
    const auto& its = triangles[of];
    triangles_[of].beyond[std::find(its.begin(), its.end(), from) - its.begin()] = other->second;
  }
  if (volume < -kLeastVolume) refuse("is turned inside out: expected the corners of each triangle counter-clockwise seen from outside");
  if (volume < kLeastVolume) refuse("is flat: expected a body");
  for (std::size_t k = 0; k < planes_.size(); ++k) {
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const double beyond = planes_[k].normal.dot(corners[i]) - planes_[k].height;
      if (beyond <= kConvex) continue;
      refuse("is not convex: corner ", i, " is ", 1e3 * beyond, " mm outside the plane of triangle ", k,
             ". Give its convex hull, or several bodies that are convex");
    }
  }
  for (const Vector3& corner : corners) reach_ = std::max(reach_, corner.norm());
}

// Below the point, where that is within the triangle, or else on one of the edges that it is beyond.
Mesh::Foot Mesh::foot(int triangle, const Vector3& p) const noexcept {
  const Triangle& t = triangles_[triangle];
  Foot best;
  best.squared = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 3; ++i) {
    const Vector3 from = p - t.corner[i];
    if (t.across[i].dot(from) <= 0) continue;
    const double along = t.edge[i].dot(from) / t.edge[i].squaredNorm();
    const Vector3 away = from - std::clamp(along, 0., 1.) * t.edge[i];
    if (const double squared = away.squaredNorm(); squared < best.squared) {
      best = {away, squared, i, along <= 0 ? i : along >= 1 ? (i + 1) % 3 : -1};
    }
  }
  if (best.edge >= 0) return best;
  const double height = planes_[triangle].normal.dot(p) - planes_[triangle].height;
  return {height * planes_[triangle].normal, height * height};
}

Mesh::Foot Mesh::beside(int& triangle, const Foot& at, const Vector3& p) const noexcept {
  Foot best = at;
  const int from = triangle;
  const auto look = [&](int other) {
    if (const Foot there = foot(other, p); there.squared < best.squared) best = there, triangle = other;
  };
  if (at.corner < 0) {
    look(triangles_[from].beyond[at.edge]);
    return best;
  }
  // All about the corner.
  const Vector3& corner = triangles_[from].corner[at.corner];
  int edge = at.corner;  // that leaves it
  for (int other = triangles_[from].beyond[edge], turns = 0; other != from && turns < kMostAbout; ++turns) {
    look(other);
    // There that edge comes to the corner.
    int i = 0;
    while (i < 2 && triangles_[other].corner[i] != corner) ++i;
    other = triangles_[other].beyond[i];
  }
  return best;
}

// Inside it is the plane that is nearest. Outside no point is nearer than the plane that is farthest; from a foot on that triangle
// the surface is followed for as long as that leads nearer. A convex body has no other place that nothing beside is nearer than.
Distance Mesh::distance(const Vector3& p) const noexcept {
  double most = -std::numeric_limits<double>::infinity();
  int triangle = 0;
  for (std::size_t k = 0; k < planes_.size(); ++k) {
    const double height = planes_[k].normal.dot(p) - planes_[k].height;
    if (height > most) most = height, triangle = static_cast<int>(k);
  }
  if (most <= kRounding) return {most, planes_[triangle].normal};
  Foot best = foot(triangle, p);
  for (std::size_t steps = 0; best.edge >= 0 && steps < planes_.size(); ++steps) {
    const Foot next = beside(triangle, best, p);
    if (next.squared >= best.squared) break;
    best = next;
  }
  const double distance = std::sqrt(best.squared);
  return {distance, best.away / distance};
}

}  // namespace realtime
