#pragma once

#include <span>
#include <string>

#include "realtime/walls/arm_capsules.hpp"

namespace server {

// Throws Refused where a way of joints, from where the arm is, leads it so near to itself that the robot would stop it: two of
// the vendor's capsules, of links at least three joints apart, nearer than the vendor's margin and our own for what the arm does
// beside its reference. An arm that begins nearer may go away. What the arm holds does not count: the robot does not know of it.
// `what` names the motion.
void check_self_collision(const realtime::ArmCapsules& arm, std::span<const realtime::Vector7> way, const std::string& what);

}  // namespace server
