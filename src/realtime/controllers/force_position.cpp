#include "realtime/controllers/force_position.hpp"

#include <algorithm>

#include "models/arm.hpp"
#include "realtime/check.hpp"
#include "realtime/cholesky.hpp"
#include "realtime/controllers/fastest_damping.hpp"
#include "realtime/controllers/felt_wrench.hpp"
#include "realtime/controllers/require_holdable.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/inertia_along.hpp"
#include "realtime/rotation.hpp"

namespace realtime {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr double kIntegral = 10;         // 1/s, of a force gain
constexpr double kDamping = 1e-4;        // of J J^T
constexpr double kTurning = 5;           // 1/m: rad/s for m/s
constexpr double kNullspaceDamping = 5;  // N m s/rad
// How far start() moves the reference, m and rad.
constexpr double kMaxShift = 0.1, kMaxTurn = 0.5;

// Where what is among the gains, and the first of them in the message.
constexpr int kPositionCart = 0, kForceCart = 6, kPositionJoint = 12, kForceJoint = 19, kSelection = 26;
constexpr std::size_t kFirst = 2;

using Gains = GainStream<32>::Gains;

Gains gains_of(const ForcePosition::Parameters& p) {
  Gains gains;
  gains << p.position_kps_cart, p.force_kps_cart, p.position_kps_joint, p.force_kps_joint, p.selection;
  return gains;
}

void check(const Gains& gains) {
  const auto within = [&](const char* field, int first, int i, double most, const char* unit) {
    require_within(field, i, gains[first + i], 0, most, unit);
  };
  for (int i = 0; i < 6; ++i) {
    within("selection", kSelection, i, 1, "");
    within("position_kps_cart", kPositionCart, i, i < 3 ? 3000 : 300, i < 3 ? "N/m" : "N m/rad");
    within("force_kps_cart", kForceCart, i, 2, "");
  }
  for (int i = 0; i < models::kJoints; ++i) {
    within("position_kps_joint", kPositionJoint, i, 3000, "N m/rad");
    within("force_kps_joint", kForceJoint, i, 2, "");
  }
}

}  // namespace

ForcePosition::ForcePosition(const Parameters& parameters) : ForcePosition(parameters, GainStream<32>::Check(check)) {}

ForcePosition::ForcePosition(const Parameters& parameters, const Matrix7& mass)
    : ForcePosition(parameters, [inertia = felt_inertia(mass), cartesian = parameters.use_cartesian_gains](const Gains& gains) {
        check(gains);
        const Vector7 K = gains.segment<7>(kPositionJoint);
        if (!cartesian) {
          require_holdable(K, 2 * K.cwiseSqrt(), inertia, {"position_kps_joint", "2 sqrt(position_kps_joint)"});
        }
      }) {}

ForcePosition::ForcePosition(const Parameters& parameters, const GainStream<32>::Check& check)
    : gains_(gains_of(parameters), parameters.topic, "ForcePositionControllerSensorMessage", kFirst, check),
      use_cartesian_gains_(parameters.use_cartesian_gains),
      max_speed_(parameters.max_speed) {
  require_within("max_speed", -1, parameters.max_speed, 0.001, 0.2, "m/s");
}

// The spring that asks for what the torque before leaves at EE, along axes of position: K_q at EE is taken for its
// diagonal, and what that leaves fades away.
void ForcePosition::start(const Cycle& cycle, Reference& reference) noexcept {
  for (ForceServo& each : servos_) each.start();
  CartesianReference& pose = reference.cartesian;
  Vector7 tau;
  step(cycle, reference, tau);
  for (ForceServo& each : servos_) each.start();
  const Matrix67& J = cycle.model.jacobian();
  Matrix6 JJt = J * J.transpose();
  JJt.diagonal().array() += kDamping;
  const Cholesky<6> solver(JJt);
  const Vector6 change = solver.solve<1>(J * (cycle.tau_J_d - tau));
  const Gains& gains = gains_.now();
  Vector6 shift = Vector6::Zero();
  for (int i = 0; i < 6; ++i) {
    const double S = gains[kSelection + i];
    double K = gains[kPositionCart + i];
    if (!use_cartesian_gains_) {
      const Vector7 dq = J.transpose() * solver.solve<1>(Vector6::Unit(i));
      K = dq.dot(gains.segment<7>(kPositionJoint).cwiseProduct(dq));
    }
    const double most = i < 3 ? kMaxShift : kMaxTurn;
    if (S * K > 0) shift[i] = std::clamp(change[i] / (S * K), -most, most);
  }
  pose.position += shift.head<3>();
  pose.orientation = (exp(shift.tail<3>()) * pose.orientation).normalized();
}

bool ForcePosition::all_position() const noexcept { return (gains_.now().segment<6>(kSelection).array() == 1).all(); }

Vector6 ForcePosition::led_pose(const Cycle&, const Vector6& way) const noexcept {
  if (!use_cartesian_gains_) return way;
  const Gains& gains = gains_.now();
  return (gains.segment<6>(kSelection).cwiseProduct(gains.segment<6>(kPositionCart)).array() > 0).select(way, 0);
}

void ForcePosition::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  gains_.step(cycle.dt);
  const Gains& gains = gains_.now();
  const auto S = gains.segment<6>(kSelection);
  const auto force_kps_joint = gains.segment<7>(kForceJoint);
  const Matrix67& J = cycle.model.jacobian();
  const CartesianReference& pose = reference.cartesian;
  const Vector6 e = change_between(at(cycle.O_T_EE), pose);
  const Vector6 v = J * cycle.dq;
  Matrix6 JJt = J * J.transpose();
  JJt.diagonal().array() += kDamping;
  const Cholesky<6> solver(JJt);

  Vector6 force = Vector6::Zero(), missing = Vector6::Zero();
  const Cholesky<models::kJoints> M(cycle.model.mass());
  const auto inertia = [&](int i) { return inertia_along(M, J.row(i).transpose()); };
  if (!all_position()) {
    const Vector6 felt = felt_wrench(cycle);
    for (int i = 0; i < 6; ++i) {
      if (S[i] == 1) continue;
      const double weight = inertia(i);
      const double gain = use_cartesian_gains_ ? gains[kForceCart + i] : 0;
      const double integral = kIntegral * (use_cartesian_gains_ ? gain : force_kps_joint.mean());
      const double v_max = (i < 3 ? 1 : kTurning) * max_speed_;
      const double most = ForceServo::damping(weight) * v_max;
      missing[i] = (1 - S[i]) * std::clamp(reference.wrench[i] - felt[i], -most, most);
      force[i] = (1 - S[i]) *
                 servos_[i].step(reference.wrench[i], felt[i], v[i], v_max, weight, gain, integral, cycle.dt);
    }
  }

  if (use_cartesian_gains_) {
    const auto K = gains.segment<6>(kPositionCart);
    Vector6 D = 2 * K.cwiseSqrt();
    for (int i = 0; i < 6; ++i) D[i] = std::min(D[i], kFastestDamping * inertia(i));
    force += S.cwiseProduct(K.cwiseProduct(e) + D.cwiseProduct(pose.velocity - v));
    const Vector7 moving_EE = J.transpose() * solver.solve(v);
    tau_J_d.noalias() = J.transpose() * force;
    tau_J_d -= kNullspaceDamping * (cycle.dq - moving_EE);
  } else {
    Vector7 K = gains.segment<7>(kPositionJoint), D = 2 * K.cwiseSqrt();
    keep_holdable(joint_mobility(cycle.model.mass()), K, D);
    const Vector7 to_reference = J.transpose() * solver.solve<1>(S.cwiseProduct(e));
    const Vector7 velocity = J.transpose() * solver.solve<1>(S.cwiseProduct(pose.velocity));
    tau_J_d = J.transpose() * force;
    tau_J_d += K.cwiseProduct(to_reference) + D.cwiseProduct(velocity - cycle.dq) +
               force_kps_joint.cwiseProduct(J.transpose() * missing);
  }
  tau_J_d += cycle.model.coriolis();
}

}  // namespace realtime
