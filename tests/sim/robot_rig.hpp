#pragma once

#include <random>
#include <string_view>

#include "sim/robot/robot.hpp"
#include "tests/sim/arm_rig.hpp"
#include "tests/sim/thresholds.hpp"

namespace sim {

// An arm with friction, noise and all.
inline World::Options as_delivered(std::string_view name) {
  World::Options options;
  options.arm = &models::arm(name);
  return options;
}

// Robot and world without sockets: what a client would send and receive, and somebody who stands beside the arm.
struct RobotRig {
  const models::Arm& arm;
  World world;
  Robot robot;
  double grip = 0;  // N, of each finger; < 0 closes

  explicit RobotRig(const World::Options& options)
      : arm(*options.arm), world(options), robot(*options.arm, options.ideal) {
    robot.sense(world.truth());
  }

  const fci::RobotState& state() const { return robot.state(); }
  Joints q() const { return joints(world.truth().q); }

  void cycle() { step(nullptr); }
  void cycle(fci::RobotCommand command) {
    command.message_id = state().message_id;
    step(robot.takes(command) ? &command : nullptr);
  }
  void wait(double seconds) {
    for (int i = 0; i < 1000 * seconds; ++i) cycle();
  }
  void push(const Wrench& wrench) {
    Vector6 values;
    Wrench::Map(values.data()) = wrench;
    world.push(values);
  }
  fci::Status start(fci::MotionGeneratorMode generator, fci::ControllerMode controller) {
    const auto status = robot.start({.controller_mode = controller, .motion_generator_mode = generator});
    cycle();
    return status;
  }
  // What holds the arm where the reference is.
  fci::RobotCommand hold() const {
    fci::RobotCommand command;
    command.q_c = state().q_d;
    command.O_T_EE_c = state().O_T_EE_c;
    return command;
  }

 private:
  void step(const fci::RobotCommand* command) {
    world.step(robot.control(command), {grip, grip});
    robot.sense(world.truth());
  }
};

using testing_tools::thresholds;

inline Joints reported(const fci::Vector7& values) { return Joints(values.data()); }
inline Wrench reported(const fci::Vector6& values) { return Wrench(values.data()); }
inline Eigen::Matrix4d reported(const fci::Pose& values) { return Eigen::Matrix4d(values.data()); }
inline fci::Pose wire(const Eigen::Matrix4d& T) {
  fci::Pose pose;
  Eigen::Matrix4d::Map(pose.data()) = T;
  return pose;
}
inline Eigen::Matrix4d transform(const Eigen::Vector3d& p, double angle, const Eigen::Vector3d& axis) {
  Eigen::Isometry3d T(Eigen::AngleAxisd(angle, axis.normalized()));
  T.translation() = p;
  return T.matrix();
}

}  // namespace sim
