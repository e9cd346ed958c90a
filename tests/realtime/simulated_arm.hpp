#pragma once

#include <cmath>
#include <string>

#include "models/arm.hpp"
#include "realtime/cholesky.hpp"
#include "realtime/controllers/joint_friction.hpp"
#include "realtime/cycle.hpp"

namespace testing_tools {

// EE of an arm with a hand: the tool's centre in the flange frame.
inline Eigen::Isometry3d F_T_hand() {
  Eigen::Isometry3d T(Eigen::AngleAxisd(models::hand::kYaw, realtime::Vector3::UnitZ()));
  T.translation().z() = models::hand::kTcp;
  return T;
}

// An arm, without friction unless it rubs, whose gravity is compensated: M ddq + coriolis = tau. A torque takes effect one
// cycle after its state, and stays for a cycle.
class SimulatedArm {
 public:
  static constexpr double kDt = 0.001;  // s

  // `motor_inertia` (kg m²) adds to each joint what the model does not know.
  explicit SimulatedArm(const std::string& name, const realtime::Vector7& motor_inertia = realtime::Vector7::Zero())
      : plant_(models::urdf(models::arm(name), 10)),
        model(models::urdf(models::arm(name), 10)),
        cycle{.state = state, .model = model},
        motor_inertia_(motor_inertia) {
    set_tool(0.73, realtime::Vector3(-0.01, 0, 0.03));
    q = realtime::Vector7::Map(models::kHome.data());
    cycle.q_ref = q;
    observe();
  }

  void set_tool(double mass, const realtime::Vector3& com) {
    const Eigen::Matrix3d I = 0.002 * Eigen::Matrix3d::Identity();
    for (realtime::Model* m : {&plant_, &model}) m->set_tool(mass, com, I, F_T_hand());
    observe();
  }

  // What the controller sees.
  void observe() {
    model.update(q, dq);
    cycle.q = q;
    cycle.dq = dq;
    cycle.O_T_EE = model.O_T_EE();
    cycle.tau_J_d = tau;
    state.control_command_success_rate = 1;
    realtime::Vector7::Map(state.tau_J_d.data()) = tau;
  }

  // One cycle under `next`, of which the arm feels the one before; `external` acts at once.
  void step(const realtime::Vector7& next, const realtime::Vector7& external = realtime::Vector7::Zero()) {
    constexpr int kSubsteps = 4;
    for (int k = 0; k < kSubsteps; ++k) {
      plant_.update(q, dq);
      realtime::Matrix7 M = plant_.mass();
      M.diagonal() += motor_inertia_;
      const realtime::Vector7 rubbed = rubs ? realtime::against_friction(dq) : realtime::Vector7::Zero();
      const realtime::Vector7 ddq = realtime::Cholesky<7>(M).solve<1>(tau + external - rubbed - plant_.coriolis());
      dq += kDt / kSubsteps * ddq;
      q += kDt / kSubsteps * dq;
    }
    tau = next;
    // What the arm exerts on the world, low-passed at 15 Hz as the robot's estimate is.
    auto felt = realtime::Vector7::Map(state.tau_ext_hat_filtered.data());
    if (feels) felt += (1 - std::exp(-2 * M_PI * 15 * kDt)) * (-external - felt);
    cycle.time += kDt;
    observe();
  }

 private:
  realtime::Model plant_;

 public:
  fci::RobotState state;
  realtime::Model model;
  realtime::Cycle cycle;
  realtime::Vector7 q, dq = realtime::Vector7::Zero(), tau = realtime::Vector7::Zero();
  bool rubs = false, feels = true;

 private:
  realtime::Vector7 motor_inertia_;
};

// How much faster than the robot allows where it is a joint moves, as a share of its greatest speed; and from where on that ends the
// motion.
inline double too_fast(const SimulatedArm& arm, const models::Limits& limits) {
  realtime::Vector7 excess;
  for (int i = 0; i < models::kJoints; ++i) {
    const double allowed = arm.dq[i] > 0 ? limits.dq_upper(i, arm.q[i]) : -limits.dq_lower(i, arm.q[i]);
    excess[i] = (std::abs(arm.dq[i]) - allowed) / limits.dq_max[i];
  }
  return excess.maxCoeff<Eigen::PropagateNaN>();
}
inline constexpr double kTolerated = 0.1;

// The arm as it is, as a reference at rest.
inline realtime::Reference pose_reference(const SimulatedArm& arm) {
  realtime::Reference reference;
  reference.motion = realtime::Channels::kPose;
  reference.cartesian.position = arm.cycle.O_T_EE.translation();
  reference.cartesian.orientation = Eigen::Quaterniond(arm.cycle.O_T_EE.linear());
  reference.joint.q = arm.q;
  return reference;
}

}  // namespace testing_tools
