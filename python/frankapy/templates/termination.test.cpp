#include <gtest/gtest.h>

#include "$name.cpp"
#include "realtime/trajectories/stay.hpp"
#include "server/arm_at_home.hpp"

TEST($Name, EndsBelowTheHeightAndNotAboveIt) {
  server::ArmAtHome home;
  Stay trajectory(Channels::kPose, 1);
  const Reference reference = home.reference(Channels::kPose);
  const Progress progress{trajectory, false, reference};
  const double z = home.cycle.O_T_EE.translation().z();

  $name::$Name message;
  message.set_height(z - 0.01);
  EXPECT_FALSE($Name(message, home.arm).step(home.cycle, progress));
  message.set_height(z + 0.01);
  EXPECT_TRUE($Name(message, home.arm).step(home.cycle, progress));
}
