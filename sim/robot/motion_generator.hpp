#pragma once

#include "models/arm.hpp"
#include "sim/robot/arm_model.hpp"
#include "wire/fci/robot_command.hpp"

namespace sim {

// The elbow of joints, rad, as the state and commands have it: the third joint's angle, and which way the fourth is bent.
std::array<double, 2> elbow(const Eigen::Matrix<double, 7, 1>& q);

// Turns the commands of one motion into the desired joint motion that the internal controllers track
// and the state reports: q_d, dq_d, ddq_d and, for Cartesian motions, O_T_EE_c, O_dP_EE_c, O_ddP_EE_c
// and the elbow. Derivatives are backward Euler at 1 ms. A Cartesian pose becomes joints by inverse kinematics, continued
// from cycle to cycle, which keeps the elbow (q3) where it is, or where the command says. Of a pose out of reach the
// joints fall short without haste; O_T_EE_c is what was asked for.
class MotionGenerator {
 public:
  struct Desired {
    Eigen::Matrix<double, 7, 1> q, dq, ddq;
    Eigen::Matrix4d O_T_EE_c;  // commanded; of q in joint motions
    Eigen::Matrix4d O_T_EE_d;  // of q
    Eigen::Matrix<double, 6, 1> O_dP_EE_c, O_ddP_EE_c;
    std::array<double, 2> elbow_c, delbow_c, ddelbow_c;
  };

  explicit MotionGenerator(const models::Arm& arm);

  // Starts a motion of that mode at rest at q (the q_d that held the arm), with F_T_EE in force.
  void start(fci::MotionGeneratorMode mode, const Eigen::Matrix<double, 7, 1>& q,
             const Eigen::Matrix4d& F_T_EE);
  // One cycle with the command that arrived. Without a motion generator (torque alone) nothing moves:
  // who reports q_d then takes the measured joints.
  void step(const fci::RobotCommand& command);
  // One cycle whose command was lost: constant acceleration.
  void extrapolate();
  // The motion begins, at rest, at this position beside the one that it was started at.
  void begin(const fci::RobotCommand& command);
  const Desired& desired() const { return desired_; }
  // Kinematics of desired().q.
  const ArmModel& model() const { return model_; }

 private:
  using Vector7 = Eigen::Matrix<double, 7, 1>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;

  bool cartesian() const;
  void rest();
  // O_T_EE_c after one cycle with that velocity.
  Eigen::Matrix4d moved(const Vector6& velocity) const;
  void move_joints(const Vector7& q);
  void move_pose(const Eigen::Matrix4d& pose);
  Vector7 inverse(const Eigen::Matrix4d& pose);
  void differentiate(const Vector7& q);
  void set_pose(const Eigen::Matrix4d& pose);
  void set_elbow(const Vector7& q);

  fci::MotionGeneratorMode mode_ = fci::MotionGeneratorMode::kIdle;
  Desired desired_;
  ArmModel model_;
  Eigen::Map<const Vector7> dq_max_;  // rad/s
  double q3_ = 0;                     // rad: where a Cartesian motion is to have the elbow
  Eigen::Matrix4d F_T_EE_ = Eigen::Matrix4d::Identity();
};

}  // namespace sim
