#include "sim/self_collision.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace sim {
namespace {

using Eigen::Vector3d;

constexpr int kHand = 8;  // models::Capsule::link
constexpr int kNeighbours = 3;
constexpr int kMaxCapsules = 16;

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

SelfCollision::SelfCollision(const models::Arm& arm) {
  const auto& [xyz, rpy] = arm.joints[7];
  const Eigen::Isometry3d flange =
      Eigen::Translation3d(xyz[0], xyz[1], xyz[2]) * Eigen::AngleAxisd(rpy[2], Vector3d::UnitZ()) *
      Eigen::AngleAxisd(rpy[1], Vector3d::UnitY()) * Eigen::AngleAxisd(rpy[0], Vector3d::UnitX());
  const Eigen::Isometry3d hand = flange * Eigen::AngleAxisd(models::hand::kYaw, Vector3d::UnitZ());
  std::vector<int> links;
  for (const models::Capsule& capsule : models::capsules()) {
    const Eigen::Isometry3d in_link = capsule.link == kHand ? hand : Eigen::Isometry3d::Identity();
    const Vector3d centre(capsule.centre[0], capsule.centre[1], capsule.centre[2]);
    const Vector3d half = capsule.length / 2 * Vector3d::Unit(capsule.axis - 'x');
    capsules_.push_back({.link = std::min(capsule.link, 7),
                         .centre = in_link * centre,
                         .half = in_link.linear() * half,
                         .radius = capsule.radius,
                         .reach = capsule.radius + capsule.length / 2});
    links.push_back(capsule.link);
  }
  for (int i = 0; i < static_cast<int>(links.size()); ++i) {
    for (int j = i + 1; j < static_cast<int>(links.size()); ++j) {
      if (links[j] - links[i] >= kNeighbours) pairs_.emplace_back(i, j);
    }
  }
}

double SelfCollision::distance(const ArmModel& at, double horizon) const {
  std::array<Vector3d, kMaxCapsules> centre, half;
  for (std::size_t i = 0; i < capsules_.size(); ++i) {
    const Capsule& capsule = capsules_[i];
    if (capsule.link == 0) {
      centre[i] = capsule.centre;
      half[i] = capsule.half;
    } else {
      centre[i].noalias() = at.O_p(capsule.link) + at.O_R(capsule.link) * capsule.centre;
      half[i].noalias() = at.O_R(capsule.link) * capsule.half;
    }
  }
  double least = 2 * horizon;
  for (const auto& [i, j] : pairs_) {
    const double too_far = horizon + capsules_[i].reach + capsules_[j].reach;
    if ((centre[i] - centre[j]).squaredNorm() > too_far * too_far) continue;
    least = std::min(
        least, segment_distance(centre[i], half[i], centre[j], half[j]) - capsules_[i].radius - capsules_[j].radius);
  }
  return least;
}

}  // namespace sim
