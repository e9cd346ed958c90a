#include "sim/robot/self_collision.hpp"

#include <algorithm>

namespace sim {
namespace {

using Eigen::Vector3d;

constexpr int kNeighbours = 3;

// Between two segments, each given by its centre and the way from there to its end (Ericson, Real-Time Collision
// Detection, 2005, section 5.1.9, with parameters from -1 to 1). No segment here is a point.
double segment_distance(const Vector3d& c1, const Vector3d& h1, const Vector3d& c2, const Vector3d& h2) {
  const Vector3d r = c1 - c2;
  const double a = h1.squaredNorm(), b = h1.dot(h2), e = h2.squaredNorm();
  const double c = h1.dot(r), f = h2.dot(r);
  const double denominator = a * e - b * b;
  double s = denominator > 1e-12 * a * e ? std::clamp((b * f - c * e) / denominator, -1., 1.) : 0;
  double t = (b * s + f) / e;
  if (std::abs(t) > 1) {
    t = std::clamp(t, -1., 1.);
    s = std::clamp((b * t - c) / a, -1., 1.);
  }
  return (r + s * h1 - t * h2).norm();
}

}  // namespace

SelfCollision::SelfCollision(const models::Arm& arm) : capsules_(arm) {
  const auto& all = capsules_.all();
  for (int i = 0; i < static_cast<int>(all.size()); ++i) {
    for (int j = i + 1; j < static_cast<int>(all.size()); ++j) {
      if (all[j].link - all[i].link >= kNeighbours) pairs_.emplace_back(i, j);
    }
  }
}

double SelfCollision::distance(const ArmModel& at, double horizon) const {
  const auto& all = capsules_.all();
  const auto [centre, half] = capsules_.place(at);
  double least = 2 * horizon;
  for (const auto& [i, j] : pairs_) {
    const double too_far = horizon + all[i].reach + all[j].reach;
    if ((centre[i] - centre[j]).squaredNorm() > too_far * too_far) continue;
    least = std::min(least, segment_distance(centre[i], half[i], centre[j], half[j]) - all[i].radius - all[j].radius);
  }
  return least;
}

}  // namespace sim
