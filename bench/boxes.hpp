#pragma once

#include <cmath>
#include <memory>

#include "realtime/walls/wall_guard.hpp"

// 20 boxes about an arm with a hand, 5 of them within 0.1 m of it at home.
inline std::unique_ptr<realtime::Walls> boxes_about(const models::Arm& arm) {
  auto out = std::make_unique<realtime::Walls>(realtime::Walls{realtime::ArmCapsules(arm, true), {}});
  const auto add = [&out](double x, double y, double z) {
    realtime::Shape box{realtime::Shape::Kind::kBox, realtime::Vector3::Constant(0.05), Eigen::Isometry3d::Identity()};
    box.O_T_S.translation() = realtime::Vector3(x, y, z);
    out->walls.push_back({static_cast<std::uint32_t>(out->walls.size() + 1), box});
  };
  // About the hand, which is at (0.31, 0, 0.49), and the elbow.
  add(0.31, 0.21, 0.5), add(0.31, -0.21, 0.5), add(0.5, 0, 0.55), add(0.31, 0, 0.34), add(-0.2, 0.2, 0.6);
  for (int k = 0; k < 15; ++k) add(0.9 * std::cos(0.4 * k), 0.9 * std::sin(0.4 * k), 0.2 + 0.05 * k);
  return out;
}
