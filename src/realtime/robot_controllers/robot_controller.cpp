#include "realtime/robot_controllers/robot_controller.hpp"

#include "realtime/robot_controllers/cartesian_pose.hpp"
#include "realtime/robot_controllers/cartesian_velocity.hpp"
#include "realtime/robot_controllers/joint_position.hpp"
#include "realtime/robot_controllers/joint_velocity.hpp"
#include "realtime/robot_controllers/torque.hpp"
#include "realtime/robot_controllers/torque_beside_motion.hpp"

namespace realtime {
namespace {

using namespace robot_controllers;

const Torque kTorque;

// An interface alone, and together with torques.
template <class Interface>
struct Both {
  const Interface alone{};
  const TorqueBesideMotion<Interface> beside{};

  const RobotController& of(bool torque) const noexcept {
    return torque ? static_cast<const RobotController&>(beside) : alone;
  }
};
const Both<JointPosition> kJointPosition;
const Both<JointVelocity> kJointVelocity;
const Both<CartesianPose> kCartesianPose;
const Both<CartesianVelocity> kCartesianVelocity;

}  // namespace

const RobotController& robot_controller(const robot::Mode& mode) noexcept {
  const bool torque = mode.controller == fci::ControllerMode::kExternal;
  switch (mode.generator) {
    case fci::MotionGeneratorMode::kJointPosition: return kJointPosition.of(torque);
    case fci::MotionGeneratorMode::kJointVelocity: return kJointVelocity.of(torque);
    case fci::MotionGeneratorMode::kCartesianPosition: return kCartesianPose.of(torque);
    case fci::MotionGeneratorMode::kCartesianVelocity: return kCartesianVelocity.of(torque);
    default: return kTorque;
  }
}

}  // namespace realtime
