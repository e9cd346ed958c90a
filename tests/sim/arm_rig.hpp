#pragma once

#include <Eigen/Geometry>

#include "sim/robot/franka_hand.hpp"
#include "sim/robot/internal_controller.hpp"
#include "sim/robot/motion_generator.hpp"
#include "sim/world/world.hpp"

namespace sim {

using Joints = Eigen::Matrix<double, 7, 1>;
using Wrench = Eigen::Matrix<double, 6, 1>;

inline Joints joints(const Vector7& values) { return Joints(values.data()); }
inline Vector7 array(const Joints& values) {
  Vector7 out;
  Joints::Map(out.data()) = values;
  return out;
}

// World, internal controller and motion generator, without the protocol: an arm with hand that does as it is told.
struct ArmRig {
  World world;
  ArmModel model;
  MotionGenerator generator;
  InternalController controller;
  Eigen::Matrix4d F_T_EE = F_T_hand_TCP();
  bool cartesian = false;  // internal Cartesian impedance instead of joint impedance
  double grip = 0;         // N, of each finger; < 0 closes

  explicit ArmRig(const World::Options& options)
      : world(options), model(*options.arm), generator(*options.arm) {
    const RigidBody hand = franka_hand();
    model.set_tool(hand.mass, hand.com, hand.inertia);
    generator.start(fci::MotionGeneratorMode::kCartesianPosition, q(), F_T_EE);
  }

  Joints q() const { return joints(world.truth().q); }
  Joints dq() const { return joints(world.truth().dq); }
  Eigen::Matrix4d O_T_TCP() const { return Eigen::Matrix4d(world.truth().O_T_TCP.data()); }

  void cycle() {
    model.update(q(), dq());
    const Joints tau = cartesian ? controller.cartesian_impedance(model, F_T_EE, q(), dq(), generator.desired())
                                 : controller.joint_impedance(model, q(), dq(), generator.desired());
    world.step(array(tau + model.gravity()), {grip, grip});
  }
  void hold(double seconds) {
    for (int i = 0; i < 1000 * seconds; ++i) cycle();
  }

  void move(const Joints& goal, double seconds) {
    const Joints from = generator.desired().q;
    generator.start(fci::MotionGeneratorMode::kJointPosition, from, F_T_EE);
    fci::RobotCommand command;
    const int n = static_cast<int>(1000 * seconds);
    for (int i = 1; i <= n; ++i) {
      command.q_c = array(from + minimum_jerk(double(i) / n) * (goal - from));
      generator.step(command);
      cycle();
    }
  }
  void move(const Eigen::Matrix4d& goal, double seconds) {
    const Eigen::Matrix4d from = generator.desired().O_T_EE_d;
    generator.start(fci::MotionGeneratorMode::kCartesianPosition, generator.desired().q, F_T_EE);
    const int n = static_cast<int>(1000 * seconds);
    for (int i = 1; i <= n; ++i) {
      generator.step(pose_command(between(from, goal, minimum_jerk(double(i) / n))));
      cycle();
    }
  }

  static double minimum_jerk(double s) { return s * s * s * (10 - 15 * s + 6 * s * s); }
  static Eigen::Matrix4d between(const Eigen::Matrix4d& from, const Eigen::Matrix4d& to, double s) {
    const Eigen::Quaterniond a(from.topLeftCorner<3, 3>()), b(to.topLeftCorner<3, 3>());
    Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
    pose.topLeftCorner<3, 3>() = a.slerp(s, b).toRotationMatrix();
    pose.topRightCorner<3, 1>() = (1 - s) * from.topRightCorner<3, 1>() + s * to.topRightCorner<3, 1>();
    return pose;
  }
  static fci::RobotCommand pose_command(const Eigen::Matrix4d& pose) {
    fci::RobotCommand command;
    Eigen::Matrix4d::Map(command.O_T_EE_c.data()) = pose;
    return command;
  }
};

// Pose with the fingers down, the hand across y.
inline Eigen::Matrix4d pointing_down(double x, double y, double z) {
  Eigen::Matrix4d pose = Eigen::Vector4d(1, -1, -1, 1).asDiagonal();
  pose.topRightCorner<3, 1>() << x, y, z;
  return pose;
}

inline double distance(const Eigen::Matrix4d& a, const Eigen::Matrix4d& b) {
  return (a.topRightCorner<3, 1>() - b.topRightCorner<3, 1>()).norm();
}
inline double angle(const Eigen::Matrix4d& a, const Eigen::Matrix4d& b) {
  return Eigen::AngleAxisd(Eigen::Matrix3d(a.topLeftCorner<3, 3>().transpose() * b.topLeftCorner<3, 3>())).angle();
}

inline World::Options ideal(const models::Arm& arm) {
  World::Options options;
  options.arm = &arm;
  options.ideal = true;
  return options;
}

}  // namespace sim
