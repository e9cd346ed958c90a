#pragma once

#include <algorithm>

#include "realtime/walls/wall_guard.hpp"

namespace testing_tools {

// The half space behind a point.
inline realtime::Shape plane(const realtime::Vector3& point, const realtime::Vector3& normal) {
  realtime::Shape shape;
  shape.O_T_S.linear() = Eigen::Quaterniond::FromTwoVectors(realtime::Vector3::UnitZ(), normal).toRotationMatrix();
  shape.O_T_S.translation() = point;
  return shape;
}

// m from the arm at q to the nearest wall.
inline double clearance_of(const realtime::Walls& walls, const realtime::Vector7& q) {
  realtime::ArmCapsules::Place place;
  walls.arm.place(q, place);
  double least = 1e9;
  for (std::size_t k = 0; k < walls.arm.all().size(); ++k) {
    for (const realtime::Wall& each : walls.walls) {
      least = std::min(least, nearest(each.shape, place.a[k], place.b[k]).distance - walls.arm.all()[k].radius);
    }
  }
  return least;
}

}  // namespace testing_tools
