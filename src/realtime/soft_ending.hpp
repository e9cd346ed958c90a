#pragma once

#include <cstdint>
#include <memory>

#include "realtime/controllers/controller.hpp"

namespace realtime {

// What an arm did where a contact ended its skill.
enum class AfterContact : std::uint8_t { kNoContact, kHeld, kComplied, kBackedOff };

// What it is to do. Holding: a reference that is ours rests at once where the arm is measured, so that no spring pushes it on;
// one that the robot moves is braked.
struct SoftEnding {
  AfterContact what = AfterContact::kHeld;
  std::unique_ptr<Controller> law = {};  // with kComplied: takes the place of the skill's, and goes on from where the arm is
  double distance = 0, speed = 0;        // with kBackedOff, of EE, m and m/s
};

}  // namespace realtime
