#pragma once

#include "models/arm.hpp"
#include "realtime/door.hpp"
#include "realtime/model.hpp"
#include "robot/driver.hpp"

namespace realtime {

// The 1 kHz loop of one arm. It lives in its own thread, owns the driver's every call, and goes on
// whatever comes through the door or from the robot; it ends when the door says quit or the
// connection is lost.
class Loop {
 public:
  struct Options {
    double hold_time = 2.0;    // s that a motion is kept with nothing to do before it is finished
    robot::Settings settings;  // in force before the first motion (tool, load, thresholds)
  };

  Loop(robot::Driver& driver, Model& model, const models::Limits& limits, const Options& options,
       Door& door);

  // Cycles until the end; false when the connection was lost.
  bool run() noexcept;

  // One cycle; false when there will be no other.
  bool cycle() noexcept;

  // Its steps and state are private to loop.cpp's author.
};

}  // namespace realtime
