#include "realtime/controllers/lqr.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <stdexcept>

#include "models/arm.hpp"
#include "realtime/check.hpp"
#include "realtime/controllers/fastest_damping.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/tick.hpp"

namespace realtime {
namespace {

using Eigen::MatrixXd;

constexpr double kMaxShift = 0.2;  // rad, of q_ref
constexpr int kAge = 16;           // cycles after which that is looked at anew
constexpr int kFirstSteps = 100;
constexpr int kDoublings = 40;     // of the horizon: 2^40 cycles, were it not over long before

// P of the discrete algebraic Riccati equation; after n steps that of a horizon of 2^n cycles.
MatrixXd solve_riccati(MatrixXd A, MatrixXd G, MatrixXd P) {
  const auto I = MatrixXd::Identity(A.rows(), A.cols());
  for (int n = 0; n < kDoublings; ++n) {
    const Eigen::PartialPivLU<MatrixXd> W(I + G * P);
    const MatrixXd W_A = W.solve(A), W_G = W.solve(G);
    const MatrixXd more = A.transpose() * P * W_A;
    G += A * W_G * A.transpose();
    A = A * W_A;
    P += (more + more.transpose()) / 2;
    if (more.norm() <= 1e-14 * P.norm()) break;
  }
  return P;
}

// Whether the powers of A do, as those of a stable loop.
bool vanishes(MatrixXd A) {
  for (int n = 0; n < kDoublings && A.norm() > 0.5; ++n) {
    A = A * A;
    if (!(A.norm() < 1e100)) return false;
  }
  return A.norm() <= 0.5;
}

}  // namespace

Lqr::Lqr(const Parameters& parameters, const Matrix7& mass) {
  constexpr int n = models::kJoints;
  for (int i = 0; i < n; ++i) {
    require_within("position_weight", i, parameters.position_weight[i], 1e-3, 1e8, "1/rad^2");
    require_within("velocity_weight", i, parameters.velocity_weight[i], 0, 1e6, "s^2/rad^2");
    require_within("torque_weight", i, parameters.torque_weight[i], 1e-3, 1e6, "1/(N m)^2");
  }
  const Matrix7 mobility = joint_mobility(mass);
  MatrixXd A = MatrixXd::Identity(2 * n, 2 * n), B(2 * n, n), Q = MatrixXd::Zero(2 * n, 2 * n);
  A.topRightCorner<n, n>().diagonal().setConstant(kTick);
  B << kTick * kTick / 2 * mobility, kTick * mobility;
  Q.diagonal() << parameters.position_weight, parameters.velocity_weight;
  const MatrixXd R = parameters.torque_weight.asDiagonal();
  const MatrixXd P = solve_riccati(A, B * R.inverse() * B.transpose(), Q);
  const MatrixXd gains = (R + B.transpose() * P * B).llt().solve(B.transpose() * P * A);
  K_ = gains.leftCols<n>();
  D_ = gains.rightCols<n>();
  K_inverse_ = Eigen::PartialPivLU<MatrixXd>(K_).inverse();
  for (int n = 0; n < kFirstSteps; ++n) find_fastest(mobility);

  // With the torque of the cycle before as a further state.
  MatrixXd loop = MatrixXd::Zero(3 * n, 3 * n);
  loop << A, B, -gains, MatrixXd::Zero(n, n);
  if (!vanishes(loop) || !K_inverse_.allFinite()) {
    throw std::invalid_argument("position_weight, velocity_weight and torque_weight make a loop that is not stable with "
                                "torque a cycle late: expected a torque_weight that is greater in relation to the others");
  }
}

// The rate of the fastest of M^-1 D, a step nearer (power iteration); and what of the gains a loop can hold with it.
void Lqr::find_fastest(const Matrix7& mobility) noexcept {
  const Vector7 next = mobility.lazyProduct(D_.lazyProduct(fastest_));
  const double rate = next.norm();
  if (rate > 0) fastest_ = next / rate;
  share_ = std::min(1., kFastestDamping / std::max(rate, kFastestDamping));
}

void Lqr::start(const Cycle& cycle, Reference& reference) noexcept {
  Vector7 tau;
  step(cycle, reference, tau);
  const Vector7 shift = K_inverse_ * (cycle.tau_J_d - tau) / share_;
  reference.joint.q += shift.cwiseMax(-kMaxShift).cwiseMin(kMaxShift);
}

void Lqr::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  const JointReference& r = reference.joint;
  if (++age_ >= kAge) {
    age_ = 0;
    find_fastest(joint_mobility(cycle.model.mass()));
  }
  tau_J_d.noalias() = K_ * (r.q - cycle.q);
  tau_J_d.noalias() += D_ * (r.dq - cycle.dq);
  tau_J_d *= share_;
  tau_J_d.noalias() += cycle.model.mass() * r.ddq;
  tau_J_d += cycle.model.coriolis();
}

}  // namespace realtime
