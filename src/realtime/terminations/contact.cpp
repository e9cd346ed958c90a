#include "realtime/terminations/contact.hpp"

#include <stdexcept>
#include <utility>

#include "realtime/check.hpp"
#include "realtime/momentum_observer.hpp"
#include "robot/collision_behavior.hpp"

namespace realtime {
namespace {

template <class Vector, class Array>
Vector thresholds(const char* field, const std::optional<Vector>& given, const Vector& otherwise, const Array& upper) {
  if (!given) return otherwise.cwiseMin(Vector::Map(upper.data()));
  for (Eigen::Index i = 0; i < given->size(); ++i) {
    require_within(field, static_cast<int>(i), (*given)[i], 0, upper[static_cast<std::size_t>(i)],
                   given->size() == 6 && i < 3 ? "N" : "N m");
  }
  return *given;
}

// Whether one of the estimates is beyond its threshold, or, without thresholds, one of the robot's flags is set.
template <class Vector, class Array>
bool touches(const std::optional<Vector>& thresholds, const Vector& estimate, const Array& flags) {
  if (!thresholds) return (Vector::Map(flags.data()).array() != 0).any();
  return (estimate.array().abs() > thresholds->array()).any();
}

}  // namespace

Contact::Contact(const Parameters& parameters, SoftEnding then, const fci::SetCollisionBehavior& reflex)
    : parameters_(parameters), then_(std::move(then)) {
  if (!parameters.cartesian && !parameters.joint) {
    throw std::invalid_argument("cartesian and joint are both false: it would look at nothing");
  }
  const bool observed = parameters.estimate == Estimate::kObserver;
  if (!observed && !parameters.force_thresholds && !parameters.torque_thresholds) return;
  const Vector6 force = observed ? MomentumObserver::kForceThresholds : Vector6::Map(reflex.lower_force_thresholds_nominal.data());
  const Vector7 torque =
      observed ? MomentumObserver::kTorqueThresholds : Vector7::Map(reflex.lower_torque_thresholds_nominal.data());
  parameters_.force_thresholds =
      thresholds("force_thresholds", parameters.force_thresholds, force, reflex.upper_force_thresholds_nominal);
  parameters_.torque_thresholds =
      thresholds("torque_thresholds", parameters.torque_thresholds, torque, reflex.upper_torque_thresholds_nominal);
}

bool Contact::step(const Cycle& cycle, const Progress& progress) noexcept {
  const fci::RobotState& state = cycle.state;
  const bool observed = parameters_.estimate == Estimate::kObserver;
  const Vector6 force = observed ? progress.O_F_ext_K : Vector6::Map(state.O_F_ext_hat_K.data());
  const Vector7 torque = observed ? progress.tau_ext : Vector7::Map(state.tau_ext_hat_filtered.data());
  return (parameters_.cartesian && touches(parameters_.force_thresholds, force, state.cartesian_contact)) ||
         (parameters_.joint && touches(parameters_.torque_thresholds, torque, state.joint_contact));
}

}  // namespace realtime
