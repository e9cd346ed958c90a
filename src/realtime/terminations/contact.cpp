#include "realtime/terminations/contact.hpp"

#include <stdexcept>

#include "realtime/check.hpp"
#include "robot/collision_behavior.hpp"

namespace realtime {
namespace {

template <class Vector, class Array>
Vector thresholds(const char* field, const std::optional<Vector>& given, const Array& lower, const Array& upper) {
  if (!given) return Vector::Map(lower.data());
  for (Eigen::Index i = 0; i < given->size(); ++i) {
    require_within(field, static_cast<int>(i), (*given)[i], 0, upper[static_cast<std::size_t>(i)],
                   given->size() == 6 && i < 3 ? "N" : "N m");
  }
  return *given;
}

// Whether one of the estimates is beyond its threshold, or, without thresholds, one of the robot's flags is set.
template <class Vector, class Array>
bool touches(const std::optional<Vector>& thresholds, const Array& estimate, const Array& flags) {
  if (!thresholds) return (Vector::Map(flags.data()).array() != 0).any();
  return (Vector::Map(estimate.data()).array().abs() > thresholds->array()).any();
}

}  // namespace

Contact::Contact(const Parameters& parameters) : parameters_(parameters) {
  if (!parameters.cartesian && !parameters.joint) {
    throw std::invalid_argument("cartesian and joint are both false: it would look at nothing");
  }
  if (!parameters.force_thresholds && !parameters.torque_thresholds) return;
  const auto& published = robot::kCollisionBehavior;
  parameters_.force_thresholds = thresholds("force_thresholds", parameters.force_thresholds,
                                            published.lower_force_thresholds_nominal, published.upper_force_thresholds_nominal);
  parameters_.torque_thresholds = thresholds("torque_thresholds", parameters.torque_thresholds,
                                             published.lower_torque_thresholds_nominal, published.upper_torque_thresholds_nominal);
}

bool Contact::step(const Cycle& cycle, const Progress&) noexcept {
  const fci::RobotState& state = cycle.state;
  return (parameters_.cartesian && touches(parameters_.force_thresholds, state.O_F_ext_hat_K, state.cartesian_contact)) ||
         (parameters_.joint && touches(parameters_.torque_thresholds, state.tau_ext_hat_filtered, state.joint_contact));
}

}  // namespace realtime
