#include "sim/motion_generator.hpp"

#include <Eigen/LU>
#include <cmath>

#include "sim/rotation.hpp"

namespace sim {
namespace {

using Vector7 = Eigen::Matrix<double, 7, 1>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Mode = fci::MotionGeneratorMode;

constexpr double kDt = 0.001;  // s

double elbow_sign(double q4) { return q4 > models::kElbowFlip ? 1 : -1; }

}  // namespace

MotionGenerator::MotionGenerator(const models::Arm& arm) : model_(arm) {
  start(Mode::kIdle, Vector7::Zero(), Eigen::Matrix4d::Identity());
}

void MotionGenerator::start(Mode mode, const Vector7& q, const Eigen::Matrix4d& F_T_EE) {
  mode_ = mode;
  F_T_EE_ = F_T_EE;
  desired_.q = q;
  desired_.dq.setZero();
  desired_.ddq.setZero();
  model_.update(q, Vector7::Zero());
  desired_.O_T_EE_c = model_.O_T_F() * F_T_EE_;
  desired_.O_dP_EE_c.setZero();
  desired_.O_ddP_EE_c.setZero();
  desired_.elbow_c = {q[2], elbow_sign(q[3])};
  desired_.delbow_c = {0, 0};
  desired_.ddelbow_c = {0, 0};
}

bool MotionGenerator::cartesian() const {
  return mode_ == Mode::kCartesianPosition || mode_ == Mode::kCartesianVelocity;
}

void MotionGenerator::step(const fci::RobotCommand& command) {
  switch (mode_) {
    case Mode::kJointPosition: move_joints(Eigen::Map<const Vector7>(command.q_c.data())); break;
    case Mode::kJointVelocity:
      move_joints(desired_.q + kDt * Eigen::Map<const Vector7>(command.dq_c.data()));
      break;
    case Mode::kCartesianPosition: {
      const Eigen::Matrix4d pose = Eigen::Map<const Eigen::Matrix4d>(command.O_T_EE_c.data());
      move_pose(pose, command.valid_elbow ? command.elbow_c[0] : desired_.elbow_c[0]);
      break;
    }
    case Mode::kCartesianVelocity:
      move_pose(moved(Eigen::Map<const Vector6>(command.O_dP_EE_c.data())),
                command.valid_elbow ? command.elbow_c[0] : desired_.elbow_c[0]);
      break;
    default: break;
  }
}

void MotionGenerator::extrapolate() {
  if (cartesian()) {
    const double rate = desired_.delbow_c[0] + kDt * desired_.ddelbow_c[0];
    move_pose(moved(desired_.O_dP_EE_c + kDt * desired_.O_ddP_EE_c), desired_.elbow_c[0] + kDt * rate);
  } else if (mode_ == Mode::kJointPosition || mode_ == Mode::kJointVelocity) {
    move_joints(desired_.q + kDt * (desired_.dq + kDt * desired_.ddq));
  }
}

Eigen::Matrix4d MotionGenerator::moved(const Vector6& velocity) const {
  Eigen::Matrix4d pose = desired_.O_T_EE_c;
  pose.topRightCorner<3, 1>() += kDt * velocity.head<3>();
  pose.topLeftCorner<3, 3>() = rotation_of(kDt * velocity.tail<3>()) * pose.topLeftCorner<3, 3>();
  return pose;
}

void MotionGenerator::move_joints(const Vector7& q) {
  differentiate(q);
  model_.update(q, Vector7::Zero());
  set_pose(model_.O_T_F() * F_T_EE_);
  set_elbow(q);
}

void MotionGenerator::move_pose(const Eigen::Matrix4d& pose, double q3) {
  const Vector7 q = inverse(pose, q3);
  differentiate(q);
  set_pose(pose);
  set_elbow(q);
}

void MotionGenerator::differentiate(const Vector7& q) {
  const Vector7 dq = (q - desired_.q) / kDt;
  desired_.ddq = (dq - desired_.dq) / kDt;
  desired_.dq = dq;
  desired_.q = q;
}

void MotionGenerator::set_pose(const Eigen::Matrix4d& pose) {
  Vector6 velocity;
  velocity.head<3>() =
      (pose.topRightCorner<3, 1>() - desired_.O_T_EE_c.topRightCorner<3, 1>()) / kDt;
  velocity.tail<3>() = rotation_between(desired_.O_T_EE_c.topLeftCorner<3, 3>(),
                                        pose.topLeftCorner<3, 3>()) / kDt;
  desired_.O_ddP_EE_c = (velocity - desired_.O_dP_EE_c) / kDt;
  desired_.O_dP_EE_c = velocity;
  desired_.O_T_EE_c = pose;
}

void MotionGenerator::set_elbow(const Vector7& q) {
  const double rate = (q[2] - desired_.elbow_c[0]) / kDt;
  desired_.ddelbow_c[0] = (rate - desired_.delbow_c[0]) / kDt;
  desired_.delbow_c[0] = rate;
  desired_.elbow_c = {q[2], elbow_sign(q[3])};
}

// Newton's method on pose and q3 together, a square system. Damped where it is near singular, so that
// the joints stay bounded and the pose is missed instead.
Vector7 MotionGenerator::inverse(const Eigen::Matrix4d& pose, double q3) {
  constexpr int kIterations = 6;
  constexpr double kConverged = 1e-10;
  constexpr double kDamping = 1e-9;
  Vector7 q = desired_.q;
  const Eigen::Vector3d F_p = F_T_EE_.topRightCorner<3, 1>();
  for (int k = 0; k < kIterations; ++k) {
    model_.update(q, Vector7::Zero());
    const Eigen::Matrix4d now = model_.O_T_F() * F_T_EE_;
    Vector7 error;
    error.head<3>() = pose.topRightCorner<3, 1>() - now.topRightCorner<3, 1>();
    error.segment<3>(3) = rotation_between(now.topLeftCorner<3, 3>(), pose.topLeftCorner<3, 3>());
    error[6] = q3 - q[2];
    if (error.squaredNorm() < kConverged * kConverged) break;
    Eigen::Matrix<double, 7, 7> A;
    A.topRows<6>() = model_.jacobian(F_p);
    A.row(6) = Vector7::Unit(2).transpose();
    Eigen::Matrix<double, 7, 7> normal = A.transpose() * A;
    normal.diagonal().array() += kDamping;
    q += normal.ldlt().solve(A.transpose() * error);
  }
  return q;
}

}  // namespace sim
