#include "realtime/momentum_observer.hpp"

#include "realtime/base_gravity.hpp"
#include "realtime/cholesky.hpp"
#include "realtime/tick.hpp"

namespace realtime {
namespace {

// Next to singularities, where torques say nothing of some wrenches, these go to zero and not to infinity.
constexpr double kDamping = 3e-5;

}  // namespace

const Vector7 MomentumObserver::kTorqueThresholds = (Vector7() << 5, 5, 5, 5, 3, 3, 3).finished();
const Vector6 MomentumObserver::kForceThresholds = (Vector6() << 12, 12, 12, 5, 5, 5).finished();

void MomentumObserver::update(const fci::RobotState& state, const Model& model, std::uint64_t ticks) noexcept {
  const Vector7 dq = Vector7::Map(state.dq.data());
  const Vector7 bias = model.coriolis() + model.gravity(base_gravity(state));
  const Vector7 momentum = model.mass() * dq;
  Vector7 r = -tau_ext_;
  if (!began_) {
    r.setZero();
    expected_ = momentum;
  } else if (ticks != 1) {
    expected_ = momentum - r / kGain;
  } else {
    // Over the cycle: the torque that was measured, dM/dt dq - C dq, and -g.
    expected_ += kTick * (Vector7::Map(state.tau_J.data()) - (bias_ + bias) / 2) + (model.mass() - M_) * (dq_ + dq) / 2;
    r = kGain / (1 + kGain * kTick) * (momentum - expected_);
    expected_ += kTick * r;
  }
  began_ = r.allFinite() && expected_.allFinite();
  if (!began_) r.setZero();
  M_ = model.mass();
  dq_ = dq;
  bias_ = bias;
  tau_ext_ = -r;

  // The wrench of which most is felt in the joints.
  const Matrix67& J = model.jacobian();
  Eigen::Matrix<double, 6, 6> JJt = J * J.transpose();
  JJt.diagonal().array() += kDamping;
  O_F_ext_K_ = Cholesky<6>(JJt).solve(Vector6(J * tau_ext_));
  const Vector3 EE_x_K = Vector3::Map(state.EE_T_K.data() + 12);
  O_F_ext_K_.tail<3>() -= (model.O_T_EE().linear() * EE_x_K).cross(O_F_ext_K_.head<3>());
}

bool MomentumObserver::collision() const noexcept { return (tau_ext_.array().abs() > kTorqueThresholds.array()).any(); }

}  // namespace realtime
