#include "realtime/controllers/cartesian_impedance.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "realtime/check.hpp"
#include "realtime/rotation.hpp"

namespace realtime {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Matrix76 = Eigen::Matrix<double, 7, 6>;

// What EE's mobility J M^-1 J^T (1/kg, 1/(kg m²)) never falls below: near a singularity the arm would
// weigh more in that direction than any arm does.
constexpr double kLeastMobility = 1e-3;
// 1/s: no mode is damped faster, as torque comes a cycle late.
constexpr double kFastestDamping = 400;
// N m/rad: a null space without stiffness is damped like one with this.
constexpr double kLeastNullspaceDamping = 1;
// How far start() moves the reference (m, rad) and the posture (rad); what a soft law would need beyond is
// left to the torque limiter.
constexpr double kMaxShift = 0.1;
constexpr double kMaxTurn = 0.5;
constexpr double kMaxPostureShift = 0.5;

// The arm as seen from EE in one cycle.
struct Dynamics {
  Matrix76 M_inv_Jt;
  Eigen::LLT<Matrix6> mobility;  // inverse of Lambda
  Vector6 v;                     // of EE
  Vector7 n, M_n;                // the joint motion that leaves EE at rest, |n| = 1, and M n
  double n_M_n;                  // its inertia, kg m²

  explicit Dynamics(const Cycle& cycle) {
    const Matrix67& J = cycle.model.jacobian();
    const Matrix7& M = cycle.model.mass();
    M_inv_Jt = M.llt().solve(J.transpose());
    Matrix6 W;
    W.noalias() = J * M_inv_Jt;
    W.diagonal().array() += kLeastMobility;
    mobility.compute(W);
    v.noalias() = J * cycle.dq;

    // I - M^-1 J^T Lambda J = n n^T M / (n^T M n), of which any column but a small one gives n. The
    // diagonal sums to 1.
    const Matrix67 Lambda_J = mobility.solve(J);
    int column = 0;
    (M_inv_Jt.array() * Lambda_J.transpose().array()).rowwise().sum().minCoeff(&column);
    n.noalias() = -M_inv_Jt * Lambda_J.col(column);
    n[column] += 1;
    n.normalize();
    M_n.noalias() = M * n;
    n_M_n = n.dot(M_n);
  }

  Vector6 Lambda(const Vector6& a) const { return mobility.solve(a); }
};

Vector6 to_reference(const Cycle& cycle, const CartesianReference& reference) {
  Vector6 e;
  e << reference.position - cycle.O_T_EE.translation(),
      log(reference.orientation * Eigen::Quaterniond(cycle.O_T_EE.linear()).conjugate());
  return e;
}

Vector3 shortened(const Vector3& x, double length) {
  const double norm = x.norm();
  return norm > length ? Vector3(x * (length / norm)) : x;
}

// D x with D = 2 zeta C^-T sqrt(C^T K C) C^-1 and Lambda = C^-T C^-1: with x = C y the law
// Lambda x'' + D x' + K x = 0 falls into modes, each of that damping ratio.
Vector6 damping_force(const Eigen::LLT<Matrix6>& mobility, const Vector6& stiffness, double ratio, const Vector6& x) {
  const Matrix6 C = mobility.matrixL();
  Matrix6 B;
  B.noalias() = C.transpose() * stiffness.asDiagonal() * C;
  const Eigen::SelfAdjointEigenSolver<Matrix6> modes(B);
  Vector6 y = x;
  mobility.matrixL().solveInPlace(y);
  y = modes.eigenvectors().transpose() * y;
  y.array() *= (2 * ratio * modes.eigenvalues().cwiseMax(0).cwiseSqrt().array()).min(kFastestDamping);
  y = modes.eigenvectors() * y;
  mobility.matrixU().solveInPlace(y);
  return y;
}

// The part of the law that does not come from stiffness.
Vector6 other_force(const Cycle& cycle, const Dynamics& arm, const CartesianReference& reference,
                    const Vector6& stiffness, double ratio) {
  return damping_force(arm.mobility, stiffness, ratio, reference.velocity - arm.v) +
         arm.Lambda(reference.acceleration - cycle.model.dJ_dq());
}

double nullspace_damping(double stiffness, double inertia) {
  return 2 * std::sqrt(std::max(stiffness, kLeastNullspaceDamping) * inertia);
}

}  // namespace

CartesianImpedance::CartesianImpedance(const Parameters& parameters)
    : damping_ratio_(parameters.damping_ratio), nullspace_stiffness_(parameters.nullspace_stiffness) {
  for (int i = 0; i < 3; ++i) {
    require_within("translational_stiffness", i, parameters.translational_stiffness[i], 0, 3000, "N/m");
    require_within("rotational_stiffness", i, parameters.rotational_stiffness[i], 0, 300, "N m/rad");
  }
  require_within("damping_ratio", -1, damping_ratio_, 0, 3, "");
  require_within("nullspace_stiffness", -1, nullspace_stiffness_, 0, 100, "N m/rad");
  stiffness_ << parameters.translational_stiffness, parameters.rotational_stiffness;
}

void CartesianImpedance::start(const Cycle& cycle, Reference& reference) noexcept {
  const Dynamics arm(cycle);
  CartesianReference& pose = reference.cartesian;

  // The torque before falls into a force at EE and a torque on the null space, as the law's own does.
  const Vector7 tau = cycle.tau_J_d - cycle.model.coriolis();
  const Vector6 force = arm.Lambda(arm.M_inv_Jt.transpose() * tau);
  const Vector6 spring = force - other_force(cycle, arm, pose, stiffness_, damping_ratio_);
  const Vector6 e = to_reference(cycle, pose);
  Vector6 shift = Vector6::Zero();
  for (int i = 0; i < 6; ++i) {
    if (stiffness_[i] > 0) shift[i] = spring[i] / stiffness_[i] - e[i];
  }
  pose.position += shortened(shift.head<3>(), kMaxShift);
  pose.orientation =
      (exp(e.tail<3>() + shortened(shift.tail<3>(), kMaxTurn)) * Eigen::Quaterniond(cycle.O_T_EE.linear()))
          .normalized();

  posture_ = cycle.q;
  if (nullspace_stiffness_ > 0) {
    const double pull = arm.n.dot(tau) + nullspace_damping(nullspace_stiffness_, arm.n_M_n) * arm.n.dot(cycle.dq);
    posture_ += std::clamp(pull / nullspace_stiffness_, -kMaxPostureShift, kMaxPostureShift) * arm.n;
  }
}

void CartesianImpedance::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  const Dynamics arm(cycle);
  const CartesianReference& pose = reference.cartesian;
  const Vector6 force =
      stiffness_.cwiseProduct(to_reference(cycle, pose)) + other_force(cycle, arm, pose, stiffness_, damping_ratio_);
  const double pull = nullspace_stiffness_ * arm.n.dot(posture_ - cycle.q) -
                      nullspace_damping(nullspace_stiffness_, arm.n_M_n) * arm.n.dot(cycle.dq);
  tau_J_d.noalias() = cycle.model.jacobian().transpose() * force;
  tau_J_d += cycle.model.coriolis() + pull / arm.n_M_n * arm.M_n;
}

}  // namespace realtime
