#include "sim/robot/virtual_walls.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace sim {
namespace {

using Eigen::Vector3d;

// From a point to the surface of a cuboid around the origin, m; negative inside.
double box_distance(const Vector3d& point, const Vector3d& half) {
  const Vector3d beyond = point.cwiseAbs() - half;
  return beyond.cwiseMax(0).norm() + std::min(beyond.maxCoeff(), 0.);
}

}  // namespace

VirtualWall VirtualWalls::get(int id) const {
  const auto found = walls_.find(id);
  return found != walls_.end() ? found->second : VirtualWall{};
}

double VirtualWalls::distance(const ArmModel& at) const {
  double least = std::numeric_limits<double>::infinity();
  if (std::ranges::none_of(walls_, [](const auto& wall) { return wall.second.active; })) return least;
  const auto& all = capsules_.all();
  const auto [centre, half] = capsules_.place(at);
  for (const auto& [id, wall] : walls_) {
    if (!wall.active) continue;
    const Eigen::Isometry3d to_wall = wall.frame.inverse();
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (all[i].link == 0) continue;
      const int balls = static_cast<int>(std::ceil(2 * half[i].norm() / kBalls)) + 1;
      for (int k = 0; k < balls; ++k) {
        const Vector3d ball = centre[i] + (balls > 1 ? 2. * k / (balls - 1) - 1 : 0) * half[i];
        least = std::min(least, box_distance(to_wall * ball - wall.size / 2, wall.size / 2) - all[i].radius);
      }
    }
  }
  return least;
}

}  // namespace sim
