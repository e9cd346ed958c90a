#include "sim/robot/external_force.hpp"

#include <Eigen/Cholesky>

#include "sim/robot/low_pass.hpp"

namespace sim {
namespace {

constexpr double kFilter = 15;  // Hz; not published
// Next to singularities, where torques say nothing of some wrenches, the estimate of these goes to zero and not to
// infinity. It costs some 0.3 % of the wrench at a typical posture.
constexpr double kDamping = 3e-5;

}  // namespace

void ExternalForce::update(const ArmModel& model, const Sensors& sensors, const Eigen::Matrix4d& F_T_K) {
  static const double gain = low_pass_gain(kFilter);
  // Torque and acceleration are means over the cycle.
  const Vector7 bias = model.coriolis() + model.gravity();
  if (!started_) bias_ = bias;
  started_ = true;
  tau += gain * (sensors.tau_J - model.mass() * sensors.ddq - 0.5 * (bias_ + bias) - tau);
  bias_ = bias;

  // The wrench at K of which most is felt in the joints.
  const ArmModel::Matrix67 J = model.jacobian(F_T_K.topRightCorner<3, 1>());
  Eigen::Matrix<double, 6, 6> JJt = J * J.transpose();
  JJt.diagonal().array() += kDamping;
  O_F_K = JJt.llt().solve(J * tau);
  const Eigen::Matrix3d O_R_K = model.O_T_F().topLeftCorner<3, 3>() * F_T_K.topLeftCorner<3, 3>();
  K_F_K.head<3>() = O_R_K.transpose() * O_F_K.head<3>();
  K_F_K.tail<3>() = O_R_K.transpose() * O_F_K.tail<3>();
}

}  // namespace sim
