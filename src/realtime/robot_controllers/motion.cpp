#include "realtime/robot_controllers/motion.hpp"

#include "realtime/tool.hpp"

namespace realtime::robot_controllers {
namespace {

// By how much positions of a state may be beside what was commanded, rad and m: float32 up to 4, and arithmetic on the robot's
// side.
constexpr double kFloat = 3e-7, kDouble = 1e-9;

}  // namespace

int Motion::pass(int ticks, Limiter& limiter, Reference& reference) const noexcept {
  for (int lost = ticks - 1; lost > 0; --lost) limiter.coast(kTick, reference);
  return 1;
}

bool Motion::reconcile(const fci::RobotState& state, fci::Version version, Limiter& limiter, Reference& reference) const noexcept {
  if (state.control_command_success_rate >= 1) return false;
  Reference robots;
  robots.motion = reference.motion;
  robots.joint.q = Vector7::Map(state.q_d.data());
  const Eigen::Isometry3d O_T_EE_c = pose(state.O_T_EE_c);
  robots.cartesian.position = O_T_EE_c.translation();
  robots.cartesian.orientation = Eigen::Quaterniond(O_T_EE_c.linear());
  return limiter.reconcile(robots, version >= fci::kFloatStateVersion ? kFloat : kDouble, kTick, reference);
}

}  // namespace realtime::robot_controllers
