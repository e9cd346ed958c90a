#include "sim/checks.hpp"

#include <cmath>

#include "sim/transform.hpp"

namespace sim {
namespace {

using fci::ControllerMode;
using fci::Error;
using Mode = fci::MotionGeneratorMode;

constexpr double kDt = 0.001;  // s

// The robot does not say from which velocity on it finds that an arm under torque control still moves.
constexpr double kRestVelocity = 0.1;  // rad/s

template <class Values>
bool finite(const Values& values) {
  for (double value : values) {
    if (!std::isfinite(value)) return false;
  }
  return true;
}

// Magnitudes of a motion's velocity and of the jump of its acceleration when it is at rest one cycle later.
std::optional<Error> stop_dead(double velocity, double jump, double max_acceleration, double max_jerk,
                               Error velocity_error, Error acceleration_error) {
  if (!(velocity / kDt <= max_acceleration)) return velocity_error;
  if (!(jump / kDt <= max_jerk)) return acceleration_error;
  return std::nullopt;
}

}  // namespace

std::optional<Error> check_values(ControllerMode controller, Mode generator, const fci::RobotCommand& command) {
  switch (generator) {
    case Mode::kJointPosition:
      if (!finite(command.q_c)) return Error::kJointPositionLimitsCommanded;
      break;
    case Mode::kJointVelocity:
      if (!finite(command.dq_c)) return Error::kJointVelocityLimitsCommanded;
      break;
    case Mode::kCartesianPosition:
      if (!is_transform(command.O_T_EE_c)) return Error::kCartesianInvalidFrame;
      break;
    case Mode::kCartesianVelocity:
      if (!finite(command.O_dP_EE_c)) return Error::kCartesianVelocityLimits;
      break;
    default: break;
  }
  const bool cartesian = generator == Mode::kCartesianPosition || generator == Mode::kCartesianVelocity;
  if (cartesian && command.valid_elbow && !finite(command.elbow_c)) return Error::kCartesianElbowLimit;
  if (controller == ControllerMode::kExternal && !finite(command.tau_J_d)) {
    return Error::kControllerTorqueDiscontinuity;
  }
  return std::nullopt;
}

std::optional<Error> check_finish(const models::Limits& limits, Mode generator,
                                  const MotionGenerator::Desired& desired) {
  if (generator == Mode::kCartesianPosition || generator == Mode::kCartesianVelocity) {
    const auto& v = desired.O_dP_EE_c;
    const auto& a = desired.O_ddP_EE_c;
    for (const auto& [from, rates] : {std::pair{0, limits.translation}, std::pair{3, limits.rotation}}) {
      const double jump = (v.segment<3>(from) / kDt + a.segment<3>(from)).norm();
      if (auto error = stop_dead(v.segment<3>(from).norm(), jump, rates.acceleration, rates.jerk,
                                 Error::kCartesianVelocityDiscontinuity,
                                 Error::kCartesianAccelerationDiscontinuity)) {
        return error;
      }
    }
    return std::nullopt;
  }
  for (int i = 0; i < models::kJoints; ++i) {
    const double jump = std::abs(desired.dq[i] / kDt + desired.ddq[i]);
    if (auto error = stop_dead(std::abs(desired.dq[i]), jump, limits.ddq_max[i], limits.dddq_max[i],
                               Error::kJointVelocityDiscontinuity,
                               Error::kJointAccelerationDiscontinuity)) {
      return error;
    }
  }
  return std::nullopt;
}

std::optional<Error> check_finish(const Eigen::Matrix<double, 7, 1>& dq) {
  if (dq.cwiseAbs().maxCoeff() <= kRestVelocity) return std::nullopt;
  return Error::kJointVelocityDiscontinuity;
}

}  // namespace sim
