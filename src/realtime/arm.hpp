#pragma once

#include "models/arm.hpp"
#include "realtime/model.hpp"
#include "robot/collision_behavior.hpp"

namespace realtime {

// What a part is constructed for: an arm, where its skill will begin.
struct Arm {
  const models::Limits& limits;
  Model& model;  // with the arm's tool, updated for q at rest
  Vector7 q;     // rad
  // Where the robot stops it: the upper thresholds; the lower ones are what it calls a contact.
  const fci::SetCollisionBehavior& reflex = robot::kCollisionBehavior;
};

}  // namespace realtime
