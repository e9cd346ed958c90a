#pragma once

#include <optional>

#include "models/arm.hpp"
#include "sim/robot/motion_generator.hpp"
#include "sim/robot/self_collision.hpp"
#include "sim/robot/virtual_walls.hpp"
#include "wire/fci/robot_command.hpp"
#include "wire/fci/service.hpp"

namespace sim {

// Consecutive cycles without a command after which a motion ends.
inline constexpr int kLostCommands = 20;

// What the robot does not let pass in a motion, as the errors that it raises; one function for each moment at which it
// looks. Derivatives of what is commanded are backward Euler at 1 ms. All limits that one function finds broken are
// raised together; docs/simulated-arm.md says which margins are not Franka's but decided here.
class Checks {
 public:
  using Vector7 = Eigen::Matrix<double, 7, 1>;
  using Desired = MotionGenerator::Desired;

  explicit Checks(const models::Arm& arm);
  // Limits are those of the system that speaks this version.
  void set_version(fci::Version version);
  const models::Limits& limits() const { return *limits_; }

  // A motion begins, at this distance from itself and from walls.
  void start(const fci::Move& request, const ArmModel& at);

  // A command that is no command: NaN or infinite, or a pose that is no transform. Only what the motion uses is looked
  // at.
  std::optional<fci::Error> values(const fci::RobotCommand& command) const;

  // Whether a motion may be asked to keep these velocities, rad/s; of the asynchronous generator.
  bool possible(const fci::Vector7& maximum_velocity) const;
  // A target of the asynchronous generator, rad: outside the range, or where FR3's velocity envelope is closed.
  fci::Errors target(const Vector7& q) const;

  // The first command of a motion: far from where the arm is.
  fci::Errors first(const fci::RobotCommand& command, const Desired& at) const;
  // The first command is a position so near to where the reference rests that the motion begins there instead.
  bool begins(const fci::RobotCommand& command, const Desired& at) const;
  // Elbow of a Cartesian command, before it is followed.
  fci::Errors elbow(const fci::RobotCommand& command, const Desired& before) const;
  // The desired motion from one cycle to the next.
  fci::Errors reference(const Desired& before, const Desired& after) const;
  // N m, without gravity; `before` is tau_J_d.
  fci::Errors torque(const Vector7& tau, const Vector7& before) const;

  // Finished although stopping dead after `desired` leaves the limits of acceleration or jerk, or far from the goal
  // (measured: O_T_EE and q); when the client commands torques, although the arm (dq) still moves.
  fci::Errors finish(const Desired& desired, const Vector7& dq, const Eigen::Matrix4d& O_T_EE, const Vector7& q) const;

  // The arm as it is, in a cycle of a motion. `model` has been updated with q and dq; tau_J (N m) is measured,
  // tau_motor what the motors are asked for; `desired` as reported.
  fci::Errors arm(const ArmModel& model, const Eigen::Matrix4d& F_T_EE, const Vector7& q, const Vector7& dq,
                  const Vector7& tau_J, const Vector7& tau_motor, const Desired& desired) const;
  // Whether measured joints are where a motion may begin; farther out somebody must guide the arm back.
  bool inside_range(const Vector7& q) const;
  // A joint is farther out than that, and goes on.
  bool leaves_range(const Vector7& q, const Vector7& dq) const;
  // Nearer to itself than it may be, or inside a virtual wall, and closing in. To be called every cycle of a motion.
  fci::Errors collision(const ArmModel& at);

  void set_wall(int id, const VirtualWall& wall, const ArmModel& at);
  const VirtualWalls& walls() const { return walls_; }

 private:
  bool joints() const;
  bool cartesian() const;
  bool torques() const { return motion_.controller_mode == fci::ControllerMode::kExternal; }

  models::Arm arm_;
  SelfCollision self_;
  VirtualWalls walls_;
  const models::Limits* limits_;
  // What a state of float32 takes from positions: half a unit in the last place of angles up to 4 rad, and of
  // places up to 2 m. Commands that continue the state are off by as much. rad, m.
  double q_rounding_ = 0, p_rounding_ = 0;
  bool begins_beside_ = false;
  // What commanded joints outside their range are called, in joint and in Cartesian motions.
  fci::Error joint_range_{}, cartesian_range_{};
  fci::Move motion_;
  double distance_ = 0, wall_distance_ = 0;  // m, of the cycle before
};

}  // namespace sim
