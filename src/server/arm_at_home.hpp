#pragma once

#include <string_view>

#include "models/arm.hpp"
#include "realtime/arm.hpp"
#include "realtime/cycle.hpp"

namespace server {

// An arm at home and at rest, without tool: what a test of a part needs around it.
class ArmAtHome {
 public:
  explicit ArmAtHome(std::string_view name = "fr3", std::uint16_t version = 10)
      : model(models::urdf(models::arm(name), version)),
        arm{models::limits(models::arm(name), version), model, realtime::Vector7::Map(models::kHome.data())} {
    place(arm.q, realtime::Vector7::Zero());
  }

  // The cycle that measures these; rad, rad/s.
  void place(const realtime::Vector7& q, const realtime::Vector7& dq) {
    model.update(q, dq);
    cycle.q = q;
    cycle.dq = dq;
    cycle.O_T_EE = model.O_T_EE();
  }

  // At rest where the arm is.
  realtime::Reference reference(realtime::Channels motion) const {
    realtime::Reference reference;
    reference.motion = motion;
    reference.joint.q = cycle.q;
    reference.cartesian.position = cycle.O_T_EE.translation();
    reference.cartesian.orientation = Eigen::Quaterniond(cycle.O_T_EE.linear());
    return reference;
  }

  realtime::Model model;
  realtime::Arm arm;
  fci::RobotState state;
  realtime::Cycle cycle{state, model};
};

}  // namespace server
