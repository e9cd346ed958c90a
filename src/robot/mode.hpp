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

  // The robot takes torques.
  bool torque() const { return controller == fci::ControllerMode::kExternal; }
  // The robot takes a reference, which it moves on by itself where commands are lost.
  bool motion() const { return generator != fci::MotionGeneratorMode::kNone; }
  bool cartesian() const {
    return generator == fci::MotionGeneratorMode::kCartesianPosition ||
           generator == fci::MotionGeneratorMode::kCartesianVelocity;
  }
};

inline constexpr Mode kTorque = {fci::ControllerMode::kExternal, fci::MotionGeneratorMode::kNone};

// What an arm of that version is asked for, and reports, to run a mode: before version 10 torque alone is
// torque beside joint velocities, which are zero.
constexpr Mode on_wire(Mode mode, fci::Version version) {
  if (mode == kTorque && version < 10) mode.generator = fci::MotionGeneratorMode::kJointVelocity;
  return mode;
}

// Robot-side settings. The robot takes them only while no motion runs; nothing is sent that is in
// force already. A setting that is not given stays as it is.
struct Settings {
  std::optional<fci::SetJointImpedance> joint_impedance;
  std::optional<fci::SetCartesianImpedance> cartesian_impedance;
  std::optional<fci::SetCollisionBehavior> collision_behavior;
  std::optional<fci::SetEEToK> EE_T_K;
  std::optional<fci::SetNEToEE> NE_T_EE;
  std::optional<fci::SetLoad> load;
  bool operator==(const Settings&) const = default;
};

}  // namespace robot
