#include "realtime/terminations/contact.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>

#include "realtime/check.hpp"

namespace realtime {
namespace {

// N, N m; N m: what franka-interface sets where a skill names no others.
constexpr std::array<double, 6> kLowerForce = {20, 20, 20, 25, 25, 25}, kUpperForce = {120, 120, 120, 125, 125, 125};
constexpr std::array<double, 7> kLowerTorque = {20, 20, 18, 18, 16, 14, 12},
                                kUpperTorque = {120, 120, 118, 118, 116, 114, 112};

template <std::size_t N, class Given>
std::array<double, N> lower(const char* field, const Given& given, const std::array<double, N>& otherwise,
                            const std::array<double, N>& upper) {
  std::array<double, N> thresholds = otherwise;
  for (std::size_t i = 0; given && i < N; ++i) {
    thresholds[i] = (*given)[static_cast<Eigen::Index>(i)];
    require_within(field, static_cast<int>(i), thresholds[i], 0, upper[i], N == 6 && i < 3 ? "N" : "N m");
  }
  return thresholds;
}

}  // namespace

Contact::Contact(const Parameters& parameters) : cartesian_(parameters.cartesian), joint_(parameters.joint) {
  if (!cartesian_ && !joint_) throw std::invalid_argument("cartesian and joint are both false: it would look at nothing");
  if (!parameters.force_thresholds && !parameters.torque_thresholds) return;
  fci::SetCollisionBehavior behavior;
  behavior.lower_force_thresholds_nominal = behavior.lower_force_thresholds_acceleration =
      lower("force_thresholds", parameters.force_thresholds, kLowerForce, kUpperForce);
  behavior.lower_torque_thresholds_nominal = behavior.lower_torque_thresholds_acceleration =
      lower("torque_thresholds", parameters.torque_thresholds, kLowerTorque, kUpperTorque);
  behavior.upper_force_thresholds_nominal = behavior.upper_force_thresholds_acceleration = kUpperForce;
  behavior.upper_torque_thresholds_nominal = behavior.upper_torque_thresholds_acceleration = kUpperTorque;
  settings_.collision_behavior = behavior;
}

bool Contact::step(const Cycle& cycle, const Progress&) noexcept {
  const auto any = [](const auto& flags) { return std::any_of(flags.begin(), flags.end(), [](double x) { return x != 0; }); };
  return (cartesian_ && any(cycle.state.cartesian_contact)) ||
         (joint_ && any(cycle.state.joint_contact));
}

}  // namespace realtime
