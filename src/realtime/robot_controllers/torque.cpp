#include "realtime/robot_controllers/torque.hpp"

namespace realtime::robot_controllers {

Reference Torque::start(const Cycle& cycle, Channels motion, Model&) const noexcept {
  Reference reference;
  reference.motion = motion;
  reference.joint.q = cycle.q;
  reference.cartesian.position = cycle.O_T_EE.translation();
  reference.cartesian.orientation = Eigen::Quaterniond(cycle.O_T_EE.linear()).normalized();
  return reference;
}

}  // namespace realtime::robot_controllers
