#include "realtime/trajectories/joint_samples.hpp"

#include <limits>
#include <sstream>
#include <stdexcept>

#include "realtime/joint_range.hpp"

namespace realtime {
namespace {

constexpr double kNearJoints = 0.1;  // rad

}  // namespace

JointSamples::JointSamples(const Samples<7>::Table& q, const models::Limits& limits, const Vector7& from)
    : JointPath(limits), samples_(q) {
  const Eigen::Index last = q.cols() - 1;
  for (Eigen::Index k = 0; k <= last; ++k) {
    for (int i = 0; i < models::kJoints; ++i) {
      const double low = k == last ? rest_min(limits, i) : limits.q_min[i];
      const double high = k == last ? rest_max(limits, i) : limits.q_max[i];
      if (!(q(i, k) >= low && q(i, k) <= high)) {
        require_within("sample " + std::to_string(k) + " of q", i, q(i, k), low, high, "rad");
      }
    }
  }
  for (int i = 0; i < models::kJoints; ++i) {
    if (std::abs(q(i, 0) - from[i]) <= kNearJoints) continue;
    std::ostringstream text;
    text << "the first sample has joint " << i + 1 << " at " << q(i, 0) << " rad, and the arm has it at " << from[i]
         << ": move it to the first sample before, within " << kNearJoints << " rad";
    throw std::invalid_argument(text.str());
  }
  samples_.visit_rates([&](const Vector7& x, const Vector7& v, const Vector7& a) {
    raise_by_joints(limits, kMotionShare, x, v, a, Vector7::Zero(), stretch_);
  });
  length_ = stretch_ * samples_.duration();
  clear_after_ = std::numeric_limits<double>::infinity();
  goal_.joint.q = q.col(last);
}

JointReference JointSamples::at(double t) const noexcept {
  const auto point = samples_.at(t / stretch_);
  return {point.x, point.v / stretch_, point.a / (stretch_ * stretch_)};
}

}  // namespace realtime
