#include "realtime/controllers/internal_impedance.hpp"

#include <stdexcept>

#include "realtime/check.hpp"

namespace realtime {
namespace {

// N m/rad, with which Franka's arms start up (frankarobotics/franka_ros, issue 349).
constexpr fci::Vector7 kDefaultK_theta = {3000, 3000, 3000, 2500, 2500, 2000, 2000};

}  // namespace

InternalImpedance::InternalImpedance(const Parameters& parameters) {
  if (parameters.K_theta && parameters.K_x) {
    throw std::invalid_argument("K_theta and K_x are both given: give at most one of them");
  }
  if (parameters.K_x) {
    fci::SetCartesianImpedance setting;
    for (int i = 0; i < 6; ++i) {
      const double K = (*parameters.K_x)[i];
      if (i < 3) require_within("K_x", i, K, 10, 3000, "N/m");
      if (i >= 3) require_within("K_x", i, K, 1, 300, "N m/rad");
      setting.K_x[i] = K;
    }
    settings_.cartesian_impedance = setting;
    return;
  }
  fci::SetJointImpedance setting{kDefaultK_theta};
  if (parameters.K_theta) {
    for (int i = 0; i < 7; ++i) {
      setting.K_theta[i] = (*parameters.K_theta)[i];
      require_within("K_theta", i, setting.K_theta[i], 0, 14250, "N m/rad");
    }
  }
  settings_.joint_impedance = setting;
}

robot::Mode InternalImpedance::mode(Channels motion) const noexcept {
  using fci::ControllerMode, fci::MotionGeneratorMode;
  return {
      settings_.cartesian_impedance ? ControllerMode::kCartesianImpedance : ControllerMode::kJointImpedance,
      motion == Channels::kJoint ? MotionGeneratorMode::kJointPosition : MotionGeneratorMode::kCartesianPosition};
}

}  // namespace realtime
