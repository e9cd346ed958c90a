#include "realtime/robot_controllers/motion.hpp"

#include "realtime/tool.hpp"

namespace realtime::robot_controllers {
namespace {

constexpr double kDoubleRounding = 1e-9;  // as kFloatRounding: arithmetic alone

}  // namespace

int Motion::pass(int ticks, Limiter& limiter, Reference& reference) const noexcept {
  for (int lost = ticks - 1; lost > 0; --lost) limiter.coast(kTick, reference);
  return 1;
}

bool Motion::reconcile(const fci::RobotState& state, fci::Version version, int ticks, Limiter& limiter,
                       Reference& reference) const noexcept {
  if (state.control_command_success_rate >= 1) return false;
  Reference robots;
  robots.motion = reference.motion;
  robots.joint.q = Vector7::Map(state.q_d.data());
  robots.joint.dq = Vector7::Map(state.dq_d.data());
  robots.joint.ddq = Vector7::Map(state.ddq_d.data());
  const Eigen::Isometry3d O_T_EE_c = pose(state.O_T_EE_c);
  robots.cartesian.position = O_T_EE_c.translation();
  robots.cartesian.orientation = Eigen::Quaterniond(O_T_EE_c.linear());
  robots.cartesian.velocity = Vector6::Map(state.O_dP_EE_c.data());
  robots.cartesian.acceleration = Vector6::Map(state.O_ddP_EE_c.data());
  return limiter.reconcile(robots, ticks, version >= fci::kFloatStateVersion ? kFloatRounding : kDoubleRounding, kTick, reference);
}

}  // namespace realtime::robot_controllers
