#pragma once

#include <optional>

#include "wire/fci/service.hpp"

namespace robot {

// A robot controller: which of libfranka's nine control interfaces runs, and for motion alone with
// which of the robot's two internal impedances.
struct Mode {
  fci::ControllerMode controller = fci::ControllerMode::kExternal;
  fci::MotionGeneratorMode generator = fci::MotionGeneratorMode::kNone;
  bool operator==(const Mode&) const = default;

  bool torque() const { return controller == fci::ControllerMode::kExternal; }
};

inline constexpr Mode kTorque = {fci::ControllerMode::kExternal, fci::MotionGeneratorMode::kNone};

// Robot-side settings. The robot takes them only while no motion runs; nothing is sent that is in
// force already. A setting that is not given stays as it is.
struct Settings {
  std::optional<fci::SetJointImpedance> joint_impedance;
  std::optional<fci::SetCartesianImpedance> cartesian_impedance;
  std::optional<fci::SetCollisionBehavior> collision_behavior;
  std::optional<fci::SetEEToK> EE_T_K;
  std::optional<fci::SetNEToEE> NE_T_EE;
  std::optional<fci::SetLoad> load;
};

}  // namespace robot
