#include "realtime/robot_settings.hpp"

#include <algorithm>
#include <optional>
#include <variant>

namespace realtime {
namespace {

// Calls visit(needed) for each setting that `skill` (or else `base`) gives and that is not in force.
template <class Visit>
void for_each_change(const robot::Settings& skill, const robot::Settings& base, const robot::Settings& in_force, Visit visit) {
  const auto compare = [&](auto member) {
    const auto& wanted = skill.*member ? skill.*member : base.*member;
    if (wanted && wanted != in_force.*member) visit(*wanted);
  };
  compare(&robot::Settings::NE_T_EE);
  compare(&robot::Settings::EE_T_K);
  compare(&robot::Settings::load);
  compare(&robot::Settings::collision_behavior);
  compare(&robot::Settings::joint_impedance);
  compare(&robot::Settings::cartesian_impedance);
}

// Notes that the robot has accepted a setting, or that nobody knows whether it has.
struct Remember {
  robot::Settings& in_force;
  bool known = true;
  void operator()(const fci::SetJointImpedance& value) const { note(in_force.joint_impedance, value); }
  void operator()(const fci::SetCartesianImpedance& value) const { note(in_force.cartesian_impedance, value); }
  void operator()(const fci::SetCollisionBehavior& value) const { note(in_force.collision_behavior, value); }
  void operator()(const fci::SetEEToK& value) const { note(in_force.EE_T_K, value); }
  void operator()(const fci::SetNEToEE& value) const { note(in_force.NE_T_EE, value); }
  void operator()(const fci::SetLoad& value) const { note(in_force.load, value); }
  template <class Other>
  void operator()(const Other&) const {}

 private:
  template <class Setting>
  void note(std::optional<Setting>& setting, const Setting& value) const {
    setting = known ? std::optional(value) : std::nullopt;
  }
};

}  // namespace

bool RobotSettings::in_force(const robot::Settings& skill) const noexcept {
  bool all = true;
  for_each_change(skill, base_, in_force_, [&](const auto&) { all = false; });
  return all;
}

void RobotSettings::ask(const robot::Settings& skill) noexcept {
  asked_ = true;
  for (std::size_t i = 0; i < count_; ++i) {
    const Setter& before = setters_[i];
    if (before.id && !before.answered) std::visit(Remember{in_force_, false}, before.request);
  }
  count_ = 0;
  for_each_change(skill, base_, in_force_, [&](const auto& setting) { setters_[count_++] = Setter{setting, std::nullopt, false}; });
}

void RobotSettings::post(robot::Driver& driver) noexcept {
  for (std::size_t i = 0; i < count_; ++i) {
    if (!setters_[i].id) setters_[i].id = driver.post(setters_[i].request);
  }
}

bool RobotSettings::take(const robot::Answer& answer) noexcept {
  for (std::size_t i = 0; i < count_; ++i) {
    Setter& setter = setters_[i];
    if (setter.answered || setter.id != answer.id) continue;
    setter.answered = true;
    if (answer.status == fci::Status::kSuccess) std::visit(Remember{in_force_}, setter.request);
    return true;
  }
  return false;
}

bool RobotSettings::answered() const noexcept {
  return std::all_of(setters_.begin(), setters_.begin() + count_, [](const Setter& setter) { return setter.answered; });
}

fci::Command RobotSettings::silent() const noexcept {
  const auto found = std::find_if(setters_.begin(), setters_.end(), [](const Setter& setter) { return !setter.answered; });
  return std::visit([](const auto& request) { return request.kCommand; }, found->request);
}

}  // namespace realtime
