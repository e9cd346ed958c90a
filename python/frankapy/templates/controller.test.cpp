#include <gtest/gtest.h>

#include "$name.cpp"
#include "server/arm_at_home.hpp"

TEST($Name, AsksForNothingAtItsReferenceAndPullsTowardsIt) {
  server::ArmAtHome home;
  $name::$Name message;
  wire::validate(message);  // fills in the defaults
  $Name controller(message, home.arm);

  Reference reference = home.reference(Channels::kJoint);
  controller.start(home.cycle, reference);
  Vector7 tau;
  controller.step(home.cycle, reference, tau);
  EXPECT_LT(tau.norm(), 1e-9);

  for (int i = 0; i < 7; ++i) {
    reference = home.reference(Channels::kJoint);
    reference.joint.q[i] += 0.01;
    controller.step(home.cycle, reference, tau);
    EXPECT_NEAR(tau[i], 0.01 * message.stiffness(i), 1e-9);
  }
}
