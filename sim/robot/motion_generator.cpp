#include "sim/robot/motion_generator.hpp"

#include <Eigen/LU>
#include <cmath>

#include "sim/robot/dt.hpp"
#include "sim/robot/rotation.hpp"

namespace sim {
namespace {

using Vector7 = Eigen::Matrix<double, 7, 1>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Mode = fci::MotionGeneratorMode;

}  // namespace

std::array<double, 2> elbow(const Vector7& q) { return {q[2], q[3] > models::kElbowFlip ? 1. : -1.}; }

MotionGenerator::MotionGenerator(const models::Arm& arm)
    : model_(arm), dq_max_(models::limits(arm, fci::kNewestVersion).dq_max.data()) {
  start(Mode::kIdle, Vector7::Zero(), Eigen::Matrix4d::Identity());
}

void MotionGenerator::start(Mode mode, const Vector7& q, const Eigen::Matrix4d& F_T_EE) {
  mode_ = mode;
  F_T_EE_ = F_T_EE;
  desired_.q = q;
  model_.update_kinematics(q);
  desired_.O_T_EE_d = desired_.O_T_EE_c = model_.O_T_F() * F_T_EE_;
  q3_ = q[2];
  desired_.elbow_c = elbow(q);
  rest();
}

void MotionGenerator::rest() {
  desired_.dq.setZero();
  desired_.ddq.setZero();
  desired_.O_dP_EE_c.setZero();
  desired_.O_ddP_EE_c.setZero();
  desired_.delbow_c = {0, 0};
  desired_.ddelbow_c = {0, 0};
}

bool MotionGenerator::cartesian() const {
  return mode_ == Mode::kCartesianPosition || mode_ == Mode::kCartesianVelocity;
}

void MotionGenerator::begin(const fci::RobotCommand& command) {
  constexpr int kSteps = 4;  // none of them goes far
  for (int i = 0; i < kSteps; ++i) {
    step(command);
    rest();
  }
}

void MotionGenerator::step(const fci::RobotCommand& command) {
  switch (mode_) {
    case Mode::kJointPosition: move_joints(Eigen::Map<const Vector7>(command.q_c.data())); break;
    case Mode::kJointVelocity:
      move_joints(desired_.q + kDt * Eigen::Map<const Vector7>(command.dq_c.data()));
      break;
    case Mode::kCartesianPosition:
      if (command.valid_elbow) q3_ = command.elbow_c[0];
      move_pose(Eigen::Map<const Eigen::Matrix4d>(command.O_T_EE_c.data()));
      break;
    case Mode::kCartesianVelocity:
      if (command.valid_elbow) q3_ = command.elbow_c[0];
      move_pose(moved(Eigen::Map<const Vector6>(command.O_dP_EE_c.data())));
      break;
    default: break;
  }
}

void MotionGenerator::extrapolate() {
  if (cartesian()) {
    q3_ += kDt * (desired_.delbow_c[0] + kDt * desired_.ddelbow_c[0]);
    move_pose(moved(desired_.O_dP_EE_c + kDt * desired_.O_ddP_EE_c));
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
  set_pose(desired_.O_T_EE_d);
  set_elbow(q);
}

void MotionGenerator::move_pose(const Eigen::Matrix4d& pose) {
  const Vector7 q = inverse(pose);
  differentiate(q);
  set_pose(pose);
  set_elbow(q);
}

void MotionGenerator::differentiate(const Vector7& q) {
  const Vector7 dq = (q - desired_.q) / kDt;
  desired_.ddq = (dq - desired_.dq) / kDt;
  desired_.dq = dq;
  desired_.q = q;
  model_.update_kinematics(q);
  desired_.O_T_EE_d = model_.O_T_F() * F_T_EE_;
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
  desired_.elbow_c = elbow(q);
}

// Newton's method on pose and q3 together, a square system, from where the joints will be if they go on as they do. Next
// to singularities it is damped (Nakamura, Hanafusa, Inverse kinematic solutions with singularity robustness for robot
// manipulator control, J. Dynamic Systems, Measurement, and Control 108(3), 1986): the pose is missed, the joints stay
// calm. Whatever is asked for, a cycle moves no joint farther than kFastest times its fastest speed allows.
Vector7 MotionGenerator::inverse(const Eigen::Matrix4d& pose) {
  constexpr int kIterations = 4;
  constexpr double kConverged = 1e-12;    // m and rad
  constexpr double kSingular = 5e-4;      // |determinant| below which damping begins; 0.037 at home
  constexpr double kDamping = 0.02;       // m and rad, at the singularity
  constexpr double kFastest = 2;
  const Eigen::Vector3d F_p = F_T_EE_.topRightCorner<3, 1>();
  Vector7 q = desired_.q + kDt * desired_.dq;
  for (int k = 0; k < kIterations; ++k) {
    model_.update_kinematics(q);
    const Eigen::Matrix4d now = model_.O_T_F() * F_T_EE_;
    Vector7 error;
    error.head<3>() = pose.topRightCorner<3, 1>() - now.topRightCorner<3, 1>();
    error.segment<3>(3) = rotation_between(now.topLeftCorner<3, 3>(), pose.topLeftCorner<3, 3>());
    error[6] = q3_ - q[2];
    if (error.squaredNorm() < kConverged * kConverged) break;
    Eigen::Matrix<double, 7, 7> A;
    A.topRows<6>() = model_.jacobian(F_p);
    A.row(6) = Vector7::Unit(2).transpose();
    using Lu = Eigen::PartialPivLU<Eigen::Matrix<double, 7, 7>>;
    const Lu lu(A);
    const double determinant = std::abs(lu.determinant());
    if (determinant >= kSingular) {
      q += lu.solve(error);
    } else {
      const double damping = kDamping * (1 - determinant / kSingular);
      Eigen::Matrix<double, 7, 7> normal = A.transpose() * A;
      normal.diagonal().array() += damping * damping;
      q += Lu(normal).solve(Vector7(A.transpose() * error));
    }
  }
  const Vector7 way = q - desired_.q;
  const double excess = (way.cwiseAbs().array() / (kFastest * kDt * dq_max_.array())).maxCoeff();
  if (!(excess > 1)) return q;
  return desired_.q + way / excess;
}

}  // namespace sim
