#include "server/urdf_limits.hpp"

#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace server {
namespace {

// Joint 1 to 7 of the arm, whatever its prefix; null where there is none.
const urdf::JointLimits* limits_of_joint(const urdf::ModelInterface& model, int number) {
  const std::string end = "joint" + std::to_string(number);
  for (const auto& [name, joint] : model.joints_) {
    if (name.ends_with(end) && name.find("finger") == std::string::npos) return joint->limits.get();
  }
  return nullptr;
}

// A bound that is stated, is a number, and is one at all: descriptions leave out what they do not know by a zero.
void lower(double& bound, double stated) {
  if (std::isfinite(stated) && stated > 0) bound = std::min(bound, stated);
}

}  // namespace

models::Limits narrowed(models::Limits limits, const std::string& urdf) {
  const auto model = urdf::parseURDF(urdf);
  if (model == nullptr) throw std::invalid_argument("the robot's URDF cannot be read");
  for (int i = 0; i < models::kJoints; ++i) {
    const auto* stated = limits_of_joint(*model, i + 1);
    if (stated == nullptr) continue;
    lower(limits.dq_max[i], stated->velocity);
    lower(limits.tau_max[i], stated->effort);
    if (!std::isfinite(stated->lower) || !std::isfinite(stated->upper) || !(stated->lower < stated->upper)) continue;
    const double q_min = std::max(limits.q_min[i], stated->lower), q_max = std::min(limits.q_max[i], stated->upper);
    if (!(q_min < q_max)) {
      throw std::invalid_argument("the robot's URDF says that joint " + std::to_string(i + 1) + " goes from " +
                                  std::to_string(stated->lower) + " to " + std::to_string(stated->upper) +
                                  " rad, which is outside of what this model of arm does: expected " +
                                  std::to_string(limits.q_min[i]) + " to " + std::to_string(limits.q_max[i]) + " rad");
    }
    // The envelope ends where it did, seen from the end of the range.
    limits.envelope_min[i] += q_min - limits.q_min[i];
    limits.envelope_max[i] += q_max - limits.q_max[i];
    limits.q_min[i] = q_min;
    limits.q_max[i] = q_max;
  }
  return limits;
}

}  // namespace server
