#include "sim/robot/contact_detection.hpp"

#include <cmath>

namespace sim {
namespace {

// Whether anything is above its upper threshold.
template <class Values, std::size_t N>
bool detect(const Values& values, const std::array<double, N>& lower, const std::array<double, N>& upper,
            std::array<double, N>& contact, std::array<double, N>& collision) {
  bool any = false;
  for (std::size_t i = 0; i < N; ++i) {
    const double magnitude = std::abs(values[static_cast<int>(i)]);
    contact[i] = magnitude > lower[i];
    if (magnitude > upper[i]) {
      collision[i] = 1;
      any = true;
    }
  }
  return any;
}

}  // namespace

void ContactDetection::update(const fci::SetCollisionBehavior& thresholds, bool accelerating, const Vector7& tau,
                              const Vector6& K_F) {
  if (accelerating) {
    joint = detect(tau, thresholds.lower_torque_thresholds_acceleration,
                   thresholds.upper_torque_thresholds_acceleration, joint_contact, joint_collision);
    cartesian = detect(K_F, thresholds.lower_force_thresholds_acceleration,
                       thresholds.upper_force_thresholds_acceleration, cartesian_contact, cartesian_collision);
  } else {
    joint = detect(tau, thresholds.lower_torque_thresholds_nominal, thresholds.upper_torque_thresholds_nominal,
                   joint_contact, joint_collision);
    cartesian = detect(K_F, thresholds.lower_force_thresholds_nominal, thresholds.upper_force_thresholds_nominal,
                       cartesian_contact, cartesian_collision);
  }
}

void ContactDetection::reset() {
  joint_collision = {};
  cartesian_collision = {};
}

}  // namespace sim
