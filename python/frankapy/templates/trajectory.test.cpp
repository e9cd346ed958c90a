#include <gtest/gtest.h>

#include "$name.cpp"
#include "server/arm_at_home.hpp"

TEST($Name, NodsAndComesBackWithVelocitiesThatAreThoseOfItsPositions) {
  server::ArmAtHome home;
  const $name::$Name message;
  $Name trajectory(message, home.arm);
  const Reference from = home.reference(Channels::kJoint);
  trajectory.start(from);
  const int joint = static_cast<int>(message.joint()) - 1;
  const double T = message.duration(), h = 1e-5;

  Reference now, before, after;
  EXPECT_FALSE(trajectory.step(home.cycle, T / 2, now));
  EXPECT_NEAR(now.joint.q[joint] - from.joint.q[joint], message.angle(), 1e-9);
  for (double t = 0.1; t < T; t += 0.1) {
    trajectory.step(home.cycle, t, now);
    trajectory.step(home.cycle, t - h, before);
    trajectory.step(home.cycle, t + h, after);
    EXPECT_NEAR(now.joint.dq[joint], (after.joint.q[joint] - before.joint.q[joint]) / (2 * h), 1e-6);
    EXPECT_NEAR(now.joint.ddq[joint], (after.joint.dq[joint] - before.joint.dq[joint]) / (2 * h), 1e-6);
  }
  EXPECT_TRUE(trajectory.step(home.cycle, T, now));
  EXPECT_EQ(now.joint.q, from.joint.q);
}
