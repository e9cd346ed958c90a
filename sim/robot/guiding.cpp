#include "sim/robot/guiding.hpp"

#include "sim/robot/rotation.hpp"

namespace sim {
namespace {

constexpr double kTranslation = 2500;    // N/m
constexpr double kRotation = 150;        // N m/rad
constexpr double kElbow = 100;           // N m/rad
constexpr double kTranslationDamping = 150;  // N s/m
constexpr double kRotationDamping = 8;       // N m s/rad
constexpr double kElbowDamping = 10;         // N m s/rad
constexpr double kFreeDamping = 1;           // N m s/rad, of every joint

}  // namespace

void Guiding::start(const fci::SetGuidingMode& unlocked, const ArmModel& model, const Eigen::Matrix4d& F_T_EE,
                    const Vector7& q) {
  unlocked_ = unlocked;
  O_T_EE_d_ = model.O_T_F() * F_T_EE;
  q3_ = q[2];
}

Guiding::Vector7 Guiding::torque(const ArmModel& model, const Eigen::Matrix4d& F_T_EE, const Vector7& q,
                                 const Vector7& dq) {
  const Eigen::Matrix4d O_T_EE = model.O_T_F() * F_T_EE;
  const Eigen::Matrix3d R = O_T_EE.topLeftCorner<3, 3>();
  const ArmModel::Matrix67 J = model.jacobian(F_T_EE.topRightCorner<3, 1>());
  const ArmModel::Vector6 velocity = J * dq;
  ArmModel::Vector6 error, force;
  error.head<3>() = (O_T_EE_d_ - O_T_EE).topRightCorner<3, 1>();
  error.tail<3>() = rotation_between(R, O_T_EE_d_.topLeftCorner<3, 3>());
  for (int i = 0; i < 6; ++i) {
    if (unlocked_.guiding_mode[i]) error[i] = 0;
    const bool turns = i >= 3;
    force[i] = unlocked_.guiding_mode[i] ? 0
                                         : (turns ? kRotation : kTranslation) * error[i] -
                                               (turns ? kRotationDamping : kTranslationDamping) * velocity[i];
  }
  // What is free takes the goal along.
  O_T_EE_d_.topRightCorner<3, 1>() = O_T_EE.topRightCorner<3, 1>() + error.head<3>();
  O_T_EE_d_.topLeftCorner<3, 3>() = rotation_of(error.tail<3>()) * R;

  Vector7 tau = J.transpose() * force - kFreeDamping * dq + model.coriolis();
  if (!unlocked_.nullspace) tau[2] += kElbow * (q3_ - q[2]) - kElbowDamping * dq[2];
  return tau;
}

}  // namespace sim
