#include "realtime/walls/arm_capsules.hpp"

#include <algorithm>
#include <cmath>

namespace realtime {
namespace {

constexpr double kReachOfFlange = 0.86;  // m/rad: the links between joint 2 and the flange, stretched out

Eigen::Isometry3d frame(const models::JointFrame& joint) {
  const auto& [xyz, rpy] = joint;
  Eigen::Isometry3d T(Eigen::AngleAxisd(rpy[2], Vector3::UnitZ()) * Eigen::AngleAxisd(rpy[1], Vector3::UnitY()) *
                      Eigen::AngleAxisd(rpy[0], Vector3::UnitX()));
  T.translation() = Vector3::Map(xyz.data());
  return T;
}

}  // namespace

ArmCapsules::ArmCapsules(const models::Arm& arm, bool hand) {
  for (std::size_t i = 0; i < frames_.size(); ++i) frames_[i] = frame(arm.joints[i]);
  const Eigen::Isometry3d F_T_hand(Eigen::AngleAxisd(models::hand::kYaw, Vector3::UnitZ()));
  const auto add = [&](const models::Capsule& capsule) {
    const Vector3 centre = Vector3::Map(capsule.centre.data()), half = capsule.length / 2 * Vector3::Unit(capsule.axis - 'x');
    const Eigen::Isometry3d T = capsule.link == kFlange ? F_T_hand : capsule.link == 1 ? frames_[0] : Eigen::Isometry3d::Identity();
    auto& which = capsule.link <= 1 ? fixed_ : capsules_;
    which.push_back({capsule.link, T * (centre - half), T * (centre + half), capsule.radius});
  };
  for (const models::Capsule& capsule : models::capsules()) {
    if (capsule.link != kFlange || hand) add(capsule);
  }
  own_ = capsules_.size();
  if (hand) add(models::kHandHull);
  held_ = capsules_.size();
}

bool ArmCapsules::hold(const Vector3& F_a, const Vector3& F_b, double radius) {
  if (capsules_.size() >= kMost) return false;
  capsules_.push_back({kFlange, F_a, F_b, radius});
  reach_ = std::max(reach_, kReachOfFlange + std::max(F_a.norm(), F_b.norm()) + radius);
  return true;
}

// lazyProduct(), as Eigen's product of frames is a call for each part of it.
void ArmCapsules::place(const Vector7& q, Place& out) const noexcept {
  std::array<Eigen::Matrix3d, models::kJoints + 1> R;
  std::array<Vector3, models::kJoints + 1> p;
  Eigen::Matrix3d R_before = Eigen::Matrix3d::Identity();
  Vector3 p_before = Vector3::Zero();
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    p[i] = p_before + R_before.lazyProduct(frames_[i].translation());
    R[i] = R_before.lazyProduct(frames_[i].linear());
    if (i == models::kJoints) break;
    out.origin[i] = p[i];
    out.axis[i] = R[i].col(2);
    const double c = std::cos(q[i]), s = std::sin(q[i]);
    const Vector3 x = R[i].col(0), y = R[i].col(1);
    R[i].col(0) = c * x + s * y;
    R[i].col(1) = c * y - s * x;
    R_before = R[i];
    p_before = p[i];
  }
  for (std::size_t k = 0; k < capsules_.size(); ++k) {
    const Capsule& capsule = capsules_[k];
    out.a[k] = p[capsule.link - 1] + R[capsule.link - 1].lazyProduct(capsule.a);
    out.b[k] = p[capsule.link - 1] + R[capsule.link - 1].lazyProduct(capsule.b);
  }
}

Vector7 ArmCapsules::gradient(const Place& place, int index, const Vector3& O_point, const Vector3& normal) const noexcept {
  Vector7 out = Vector7::Zero();
  const int joints = std::min(capsules_[index].link, models::kJoints);
  for (int i = 0; i < joints; ++i) out[i] = normal.dot(place.axis[i].cross(O_point - place.origin[i]));
  return out;
}

}  // namespace realtime
