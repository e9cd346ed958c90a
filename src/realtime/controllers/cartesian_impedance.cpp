#include "realtime/controllers/cartesian_impedance.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "realtime/check.hpp"
#include "realtime/cholesky.hpp"
#include "realtime/controllers/fastest_damping.hpp"
#include "realtime/controllers/integral.hpp"
#include "realtime/controllers/joint_friction.hpp"
#include "realtime/rotation.hpp"
#include "realtime/shortened.hpp"
#include "realtime/symmetric_eigen.hpp"

namespace realtime {
namespace {

using Matrix76 = Eigen::Matrix<double, 7, 6>;

// What EE's mobility J M^-1 J^T (1/kg, 1/(kg m²)) never falls below: near a singularity the arm would
// weigh more in that direction than any arm does.
constexpr double kLeastMobility = 1e-3;
// 1/kg (1/(kg m²)), what EE's mobilities sum to in series: 0.055 at home, 0.044 folded, 0.033 with the elbow bent by 1 rad, 0.008
// by 0.67. From the first on the joints are held in what hardly moves EE; the second is what then counts as hardly.
constexpr double kNearlySingular = 0.02, kHardly = 0.05;
// Cycles after which the modes are found anew.
constexpr int kModesAge = 8;
// N m/rad: a null space without stiffness is damped like one with this.
constexpr double kLeastNullspaceDamping = 1;
// How far start() moves the reference (m, rad) and the posture (rad); what a soft law would need beyond is
// left to the torque limiter.
constexpr double kMaxShift = 0.1;
constexpr double kMaxTurn = 0.5;
constexpr double kMaxPostureShift = 0.5;
constexpr double kPostureFade = 0.999;  // a cycle, of what the posture is shifted by

constexpr double kNoMode = 1e-2;         // 1/s: less is the damping of a direction without stiffness
constexpr double kIntegralFade = 0.99;   // a cycle, of an integral whose stiffness a message has taken away

constexpr std::size_t kFirst = 2;  // of the stiffness in its message

Vector6 stiffness(const CartesianImpedance::Parameters& parameters) {
  Vector6 K;
  K << parameters.translational_stiffness, parameters.rotational_stiffness;
  return K;
}

void check(const Vector6& stiffness) {
  for (int i = 0; i < 3; ++i) {
    require_within("translational_stiffness", i, stiffness[i], 0, 3000, "N/m");
    require_within("rotational_stiffness", i, stiffness[3 + i], 0, 300, "N m/rad");
  }
}

double nullspace_damping(double stiffness, double inertia) {
  return 2 * std::sqrt(std::max(stiffness, kLeastNullspaceDamping) * inertia);
}

}  // namespace

// The arm as seen from EE in one cycle.
struct CartesianImpedance::Dynamics {
  Matrix76 M_inv_Jt;
  Cholesky<6> mobility;  // inverse of Lambda
  Vector6 v;             // of EE
  Vector7 n, M_n;        // the joint motion that leaves EE at rest, |n| = 1, and M n
  double n_M_n;          // its inertia, kg m²

  explicit Dynamics(const Cycle& cycle)
      : M_inv_Jt(Cholesky<7>(cycle.model.mass()).solve<6>(cycle.model.jacobian().transpose())),
        mobility(matrix(cycle, kLeastMobility)),
        v(cycle.model.jacobian() * cycle.dq) {}

  // Finds n from a column of I - M^-1 J^T Lambda J = n n^T M / (n^T M n), whose diagonal sums to 1. The joint whose column
  // has the most on it.
  int find_null_motion(const Cycle& cycle, int column) noexcept {
    n.noalias() = -M_inv_Jt * mobility.solve<1>(cycle.model.jacobian().col(column));
    n[column] += 1;
    n.normalize();
    M_n.noalias() = cycle.model.mass() * n;
    n_M_n = n.dot(M_n);
    int most = 0;
    n.cwiseProduct(M_n).maxCoeff(&most);
    return most;
  }

  Vector6 Lambda(const Vector6& a) const { return mobility.solve(a); }

  // Next to a singularity up to 1, elsewhere not above 0.
  double nearness() const noexcept { return 1 - 1 / (kNearlySingular * mobility.inverse().trace()); }

  // Of a torque what, so near to a singularity, moves joints that hardly move EE: the difference that more regularization makes to
  // what I - J^T Lambda J M^-1 leaves of it.
  Vector7 hardly_moving(const Cycle& cycle, double near, const Vector7& tau) const noexcept {
    const Cholesky<6> more(matrix(cycle, kLeastMobility + kHardly * near * near));
    const Vector6 a = M_inv_Jt.transpose() * tau;
    return cycle.model.jacobian().transpose() * (mobility.solve(a) - more.solve(a));
  }

 private:
  Matrix6 matrix(const Cycle& cycle, double least) const noexcept {
    Matrix6 W = cycle.model.jacobian().lazyProduct(M_inv_Jt);
    W.diagonal().array() += least;
    return W;
  }
};

Vector6 CartesianImpedance::in_frame(const Cycle& cycle, const Vector6& v) const noexcept {
  Vector6 out;
  if (frame_ == Frame::kBase) {
    out << axes_.transpose() * v.head<3>(), axes_.transpose() * v.tail<3>();
  } else {
    const Eigen::Matrix3d R = cycle.O_T_EE.linear() * axes_;
    out << R.transpose() * v.head<3>(), R.transpose() * v.tail<3>();
  }
  return out;
}

Vector6 CartesianImpedance::in_base(const Cycle& cycle, const Vector6& v) const noexcept {
  Vector6 out;
  out << axes_ * v.head<3>(), axes_ * v.tail<3>();
  if (frame_ == Frame::kEndEffector) {
    out.head<3>() = cycle.O_T_EE.linear() * out.head<3>().eval();
    out.tail<3>() = cycle.O_T_EE.linear() * out.tail<3>().eval();
  }
  return out;
}

// D = 2 zeta C^-T sqrt(C^T K C) C^-1 with Lambda = C^-T C^-1: with x = C y the law Lambda x'' + D x' + K x = 0 falls
// into modes, each of that damping ratio.
void CartesianImpedance::find_modes(const Cycle& cycle, const Dynamics& arm) noexcept {
  const Matrix6& C = arm.mobility.L();
  Matrix6 K_C;
  for (int i = 0; i < 6; ++i) K_C.col(i) = in_base(cycle, stiffness_.now().cwiseProduct(in_frame(cycle, C.col(i))));
  const SymmetricEigen<6> modes(C.transpose().lazyProduct(K_C));
  modes_ = modes.vectors;
  mode_damping_ = (2 * damping_ratio_ * modes.values.cwiseMax(0).cwiseSqrt()).cwiseMin(kFastestDamping);
  if (integral_rate_ > 0) find_least_damping(arm);
  modes_age_ = 0;
}

// A mode of inertia 1 moves the joints with M^-1 J^T C^-T: the motors add at most what they have in that motion.
void CartesianImpedance::find_least_damping(const Dynamics& arm) noexcept {
  const Vector7 B = Vector7::Map(models::kMotorInertia.data());
  least_damping_ = kFastestDamping;
  for (int k = 0; k < 6; ++k) {
    if (mode_damping_[k] < kNoMode) continue;
    const Vector7 dq = arm.M_inv_Jt * arm.mobility.solve_Lt(modes_.col(k));
    least_damping_ = std::min(least_damping_, mode_damping_[k] / (1 + dq.dot(B.cwiseProduct(dq))));
  }
}

Vector6 CartesianImpedance::damping_force(const Dynamics& arm, const Vector6& velocity_error) const noexcept {
  const Vector6 y = mode_damping_.cwiseProduct(modes_.transpose() * arm.mobility.solve_L(velocity_error));
  return arm.mobility.solve_Lt(modes_ * y);
}

// The part of the law that does not come from stiffness.
Vector6 CartesianImpedance::other_force(const Cycle& cycle, const Dynamics& arm,
                                        const CartesianReference& reference) const noexcept {
  return damping_force(arm, reference.velocity - arm.v) + arm.Lambda(reference.acceleration - cycle.model.dJ_dq());
}

// What the joints need for the reference's motion beside what the links do.
Vector7 CartesianImpedance::ahead(const Cycle& cycle, const Dynamics& arm, const CartesianReference& reference) const noexcept {
  const Vector7 ddq = arm.M_inv_Jt * arm.Lambda(reference.acceleration);
  return Vector7::Map(models::kMotorInertia.data()).cwiseProduct(ddq) + against_friction(cycle.dq_ref);
}

CartesianImpedance::CartesianImpedance(const Parameters& parameters)
    : stiffness_(stiffness(parameters), parameters.topic, "CartesianImpedanceSensorMessage", kFirst, check),
      frame_(parameters.frame),
      axes_(parameters.axes),
      damping_ratio_(parameters.damping_ratio),
      nullspace_stiffness_(parameters.nullspace_stiffness),
      integral_rate_(parameters.integral_rate),
      integral_limit_(parameters.integral_limit),
      posture_(parameters.posture) {
  require_within("damping_ratio", -1, damping_ratio_, 0, 3, "");
  require_within("nullspace_stiffness", -1, nullspace_stiffness_, 0, 100, "N m/rad");
  require_within("integral_rate", -1, integral_rate_, 0, 10, "1/s");
  for (int i = 0; i < 6; ++i) {
    require_within("integral_limit", i, integral_limit_[i], 0, i < 3 ? 100 : 20, i < 3 ? "N" : "N m");
  }
  if (posture_ && nullspace_stiffness_ == 0) {
    throw std::invalid_argument("posture is given and nullspace_stiffness is 0: nothing would lead the joints there");
  }
}

void CartesianImpedance::start(const Cycle& cycle, Reference& reference) noexcept {
  Dynamics arm(cycle);
  // Of a joint that hardly moves there the column is little more than rounding: then the one after it tells.
  for (int i = 0; i < 2; ++i) null_column_ = arm.find_null_motion(cycle, null_column_);
  find_modes(cycle, arm);
  CartesianReference& pose = reference.cartesian;

  // The torque before falls into a force at EE and a torque on the null space, as the law's own does.
  const Vector7 tau = cycle.tau_J_d - cycle.model.coriolis() - ahead(cycle, arm, reference.cartesian);
  const Vector6 force = arm.Lambda(arm.M_inv_Jt.transpose() * tau);
  const Vector6 spring = force - other_force(cycle, arm, pose);
  const Vector6 e = change_between(at(cycle.O_T_EE), pose);
  const Vector6 spring_in_frame = in_frame(cycle, spring), e_in_frame = in_frame(cycle, e);
  Vector6 shift = Vector6::Zero();
  integral_.setZero();
  for (int i = 0; i < 6; ++i) {
    const double K = stiffness_.now()[i];
    if (K == 0) continue;
    const double missing = spring_in_frame[i] - K * e_in_frame[i];
    if (integral_rate_ > 0) integral_[i] = std::clamp(missing, -integral_limit_[i], integral_limit_[i]);
    shift[i] = (missing - integral_[i]) / K;
  }
  asked_ = cycle.tau_J_d;
  shift = in_base(cycle, shift);
  pose.position += shortened(shift.head<3>(), kMaxShift);
  pose.orientation =
      (exp(e.tail<3>() + shortened(shift.tail<3>(), kMaxTurn)) * Eigen::Quaterniond(cycle.O_T_EE.linear()))
          .normalized();

  posture_shift_ = cycle.q - cycle.q_ref;
  if (nullspace_stiffness_ > 0) {
    const double pull = arm.n.dot(tau) + nullspace_damping(nullspace_stiffness_, arm.n_M_n) * arm.n.dot(cycle.dq);
    posture_shift_ += std::clamp(pull / nullspace_stiffness_, -kMaxPostureShift, kMaxPostureShift) * arm.n;
  }
}

void CartesianImpedance::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  stiffness_.step(cycle.dt);
  Dynamics arm(cycle);
  null_column_ = arm.find_null_motion(cycle, null_column_);
  if (++modes_age_ >= kModesAge) find_modes(cycle, arm);
  posture_shift_ *= kPostureFade;
  const CartesianReference& pose = reference.cartesian;
  const Vector6 spring = stiffness_.now().cwiseProduct(in_frame(cycle, change_between(at(cycle.O_T_EE), pose)));
  integrate(cycle, spring);
  const Vector6 force = in_base(cycle, spring + integral_) + other_force(cycle, arm, pose);
  const Vector7 way = cycle.q_ref + posture_shift_ - cycle.q;
  const double pull = nullspace_stiffness_ * arm.n.dot(way) -
                      nullspace_damping(nullspace_stiffness_, arm.n_M_n) * arm.n.dot(cycle.dq);
  tau_J_d.noalias() = cycle.model.jacobian().transpose() * force;
  tau_J_d += cycle.model.coriolis() + ahead(cycle, arm, pose) + pull / arm.n_M_n * arm.M_n;
  if (nullspace_stiffness_ > 0) {
    if (const double near = arm.nearness(); near > 0) tau_J_d += arm.hardly_moving(cycle, near, along(cycle, way));
  }
  asked_ = tau_J_d;
}

// Each joint by itself, a way (rad) to the posture; N m.
Vector7 CartesianImpedance::along(const Cycle& cycle, const Vector7& way) const noexcept {
  Vector7 tau = nullspace_stiffness_ * way;
  for (int i = 0; i < models::kJoints; ++i) {
    tau[i] += nullspace_damping(nullspace_stiffness_, cycle.model.mass()(i, i)) * (cycle.dq_ref[i] - cycle.dq[i]);
  }
  return tau;
}

void CartesianImpedance::integrate(const Cycle& cycle, const Vector6& spring) noexcept {
  if (integral_rate_ == 0) return;
  for (int i = 0; i < 6; ++i) {
    if (stiffness_.now()[i] == 0) integral_[i] *= kIntegralFade;
  }
  realtime::integrate(cycle, asked_, spring, integral_rate_, least_damping_, integral_limit_, integral_);
}

}  // namespace realtime
