#include "realtime/motion_gate.hpp"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <tuple>

#include "models/arm.hpp"
#include "realtime/rotation.hpp"
#include "realtime/tick.hpp"
#include "realtime/trajectories/stream_pose.hpp"
#include "realtime/walls/self_distance.hpp"
#include "tests/realtime/simulated_arm.hpp"
#include "tests/realtime/walled.hpp"

namespace {

using namespace realtime;
using testing_tools::clearance_of;
using testing_tools::plane;

// The reference of an arm with a (weightless) hand that follows poses, from home; by joints that are ours or, as far as one can
// know, a robot's.
struct Following {
  explicit Following(const models::Arm& arm, bool robots = false)
      : limits(models::limits(arm, 10)), model(models::urdf(arm, 10)), gate(limits, model), robots(robots) {
    model.set_tool(0, Vector3::Zero(), Eigen::Matrix3d::Zero(), testing_tools::F_T_hand());
    model.update(q, Vector7::Zero());
    reference.motion = Channels::kPose;
    reference.cartesian = at(model.O_T_EE());
    home = reference;
    gate.place(q);
    gate.reset(reference);
  }

  // One cycle. The fastest of the joints that it moved, by what it may do.
  double follow(const Reference& wanted) {
    const Vector7 before = q;
    observe();
    gate.follow(wanted, reference);
    return (q - before).cwiseAbs().cwiseQuotient(kTick * Vector7::Map(limits.dq_max.data())).maxCoeff();
  }

  // Likewise on the way to rest; true when it is there.
  bool brake() {
    observe();
    return gate.brake(reference);
  }

  void observe() {
    const Vector7 before = q;
    if (robots) {
      q += kTick * dq;
      for (int n = 0; n < 4; ++n) {
        const JointsOfPose joints = model.joints_of_pose(q, Model::kNoDamping);
        q += joints.dq_dP * change_between(at(joints.O_T_EE), reference.cartesian);
      }
    }
    ddq = ((q - before) / kTick - dq) / kTick;
    dq = (q - before) / kTick;
    gate.observe(reference, Vector7::Zero(), robots ? &q : nullptr);
    q = gate.joints().q;
    model.update(q, Vector7::Zero());
  }

  // m, from home.
  Vector3 way() const { return reference.cartesian.position - home.cartesian.position; }

  const models::Limits& limits;
  Model model;
  MotionGate gate;
  bool robots;
  Vector7 q = Vector7::Map(models::kHome.data());
  Vector7 dq = Vector7::Zero(), ddq = Vector7::Zero();  // of a robot's joints
  Reference reference, home;
};

// An arm with a hand that is not weightless, in random states.
class LoadedArm : public testing::TestWithParam<const char*> {
 protected:
  LoadedArm() { model.set_tool(0.73, {-0.01, 0, 0.03}, Eigen::Matrix3d::Zero(), testing_tools::F_T_hand()); }

  // The greatest torque, by what its joint can give, with which the model's state accelerates so.
  double strain(const Vector7& ddq) const {
    const Vector7 tau = model.mass() * ddq + model.coriolis() + model.gravity(down);
    return tau.cwiseAbs().cwiseQuotient(Vector7::Map(limits.tau_max.data())).maxCoeff();
  }

  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  Model model{models::urdf(models::arm(GetParam()), 10)};
  const Vector3 down{0, 0, -9.81};
  std::mt19937 random{1};
  std::uniform_real_distribution<double> share{0, 1};
};

class StretchedArm : public LoadedArm {};
INSTANTIATE_TEST_SUITE_P(Arms, StretchedArm, testing::Values("fer", "fr3"), [](const auto& info) { return std::string(info.param); });

// All joints at once, from anywhere: with all that each may brake with, some postures would need more than joint 2 can.
TEST_P(StretchedArm, brakes_with_what_its_joints_can_bear) {
  double worst = 0, worst_of_all = 0;
  for (int n = 0; n < 2000; ++n) {
    Reference reference;
    for (int i = 0; i < 7; ++i) {
      double& q = reference.joint.q[i];
      q = limits.q_min[i] + (0.2 + 0.6 * share(random)) * (limits.q_max[i] - limits.q_min[i]);
      reference.joint.dq[i] = (0.2 + 0.4 * share(random)) * (share(random) < 0.5 ? limits.dq_lower(i, q) : limits.dq_upper(i, q));
    }
    model.update(reference.joint.q, reference.joint.dq);
    worst_of_all = std::max(worst_of_all, strain(-reference.joint.dq.cwiseSign().cwiseProduct(Vector7::Map(limits.ddq_max.data()))));
    MotionGate gate(limits, model);
    gate.place(reference.joint.q);
    gate.reset(reference);
    gate.observe(reference, model.gravity(down), nullptr);
    Reference wanted = reference;
    wanted.joint.q += kTick * reference.joint.dq;
    gate.follow(wanted, reference);
    for (bool rests = false; !rests;) {
      rests = gate.brake(reference);
      model.update(reference.joint.q, reference.joint.dq);
      worst = std::max(worst, strain(reference.joint.ddq));
    }
  }
  EXPECT_LT(worst, 1.1);
  EXPECT_GT(worst_of_all, 1.15);
}

// Likewise where it makes up at once for what it is behind.
TEST_P(StretchedArm, catches_up_with_what_its_joints_can_bear) {
  double worst = 0;
  for (int n = 0; n < 1000; ++n) {
    Reference reference, wanted;
    for (int i = 0; i < 7; ++i) {
      reference.joint.q[i] = limits.q_min[i] + (0.2 + 0.6 * share(random)) * (limits.q_max[i] - limits.q_min[i]);
      wanted.joint.q[i] = reference.joint.q[i] + 0.15 * (2 * share(random) - 1);
    }
    model.update(reference.joint.q, reference.joint.dq);
    MotionGate gate(limits, model);
    gate.place(reference.joint.q);
    gate.reset(reference);
    for (int k = 0; k < 300; ++k) {
      gate.observe(reference, model.gravity(down), nullptr);
      gate.follow(wanted, reference);
      model.update(reference.joint.q, reference.joint.dq);
      worst = std::max(worst, strain(reference.joint.ddq));
    }
  }
  EXPECT_LT(worst, 1.1);
}

// Likewise where what is asked for does all that each joint may by itself.
TEST_P(StretchedArm, is_asked_for_no_more_than_its_joints_can_bear) {
  double worst = 0, worst_of_all = 0;
  int held = 0;
  for (int n = 0; n < 300; ++n) {
    Reference reference, wanted;
    Vector7 way;
    for (int i = 0; i < 7; ++i) {
      reference.joint.q[i] = limits.q_min[i] + (0.3 + 0.4 * share(random)) * (limits.q_max[i] - limits.q_min[i]);
      way[i] = 0.95 * limits.ddq_max[i] * (share(random) < 0.5 ? -1 : 1);
    }
    const Reference begin = reference;
    MotionGate gate(limits, model);
    gate.place(reference.joint.q);
    gate.reset(reference);
    for (int k = 0; k < 120; ++k) {
      constexpr double kRate = 2 * M_PI / 0.06;  // 1/s
      const double t = kTick * k, s = std::sin(kRate * t), c = std::cos(kRate * t), in = std::min(t / 0.02, 1.);
      wanted.joint.q = begin.joint.q + in * (1 - c) / (kRate * kRate) * way;
      wanted.joint.dq = in * s / kRate * way;
      wanted.joint.ddq = in * c * way;
      model.update(reference.joint.q, reference.joint.dq);
      gate.observe(reference, model.gravity(down), nullptr);
      held += has(gate.follow(wanted, reference), HeldBy::kTorqueLimits);
      model.update(reference.joint.q, reference.joint.dq);
      worst = std::max(worst, strain(reference.joint.ddq));
      worst_of_all = std::max(worst_of_all, strain(wanted.joint.ddq));
    }
  }
  EXPECT_LT(worst, 1.05);
  EXPECT_GT(worst_of_all, 1.1);
  EXPECT_GT(held, 0);
}

// Likewise where velocities are asked for that change at random and know of no end of a joint's range, with all that joints may do.
TEST_P(StretchedArm, is_braked_at_the_ends_of_its_ranges_with_what_its_joints_can_bear) {
  double worst = 0;
  for (int n = 0; n < 20; ++n) {
    Reference reference, wanted;
    for (int i = 0; i < 7; ++i) reference.joint.q[i] = limits.q_min[i] + (0.2 + 0.6 * share(random)) * (limits.q_max[i] - limits.q_min[i]);
    MotionGate gate(limits, model);
    gate.place(reference.joint.q);
    gate.reset(reference);
    Vector7 target;
    for (int k = 0; k < 3000; ++k) {
      const JointReference& now = reference.joint;
      for (int i = 0; i < 7; ++i) {
        if (k % 300 == 0) target[i] = (2 * share(random) - 1) * limits.dq_max[i];
        const double ddq_max = 0.95 * limits.ddq_max[i], change = 0.5 * limits.dddq_max[i] * kTick;
        const double ddq = std::clamp((target[i] - now.dq[i]) / 0.01, -ddq_max, ddq_max);
        wanted.joint.ddq[i] = std::clamp(ddq, now.ddq[i] - change, now.ddq[i] + change);
      }
      wanted.joint.dq = now.dq + kTick / 2 * (now.ddq + wanted.joint.ddq);
      wanted.joint.q = now.q + kTick / 2 * (now.dq + wanted.joint.dq);
      model.update(reference.joint.q, reference.joint.dq);
      gate.observe(reference, model.gravity(down), nullptr);
      gate.follow(wanted, reference);
      model.update(reference.joint.q, reference.joint.dq);
      worst = std::max(worst, strain(reference.joint.ddq));
    }
  }
  EXPECT_LT(worst, 1.05);
}

class FoldedArm : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Arms, FoldedArm, testing::Values("fer", "fr3"), [](const auto& info) { return std::string(info.param); });

// Whatever is asked for, and however its joints come to move: on the way to rest that was clear.
TEST_P(FoldedArm, keeps_from_itself) {
  const models::Arm& arm = models::arm(GetParam());
  const models::Limits& limits = models::limits(arm, 10);
  const ArmCapsules body(arm, true);
  Model model(models::urdf(arm, 10));
  MotionGate gate(limits, model);
  delete gate.keep_from(new Walls{body, {}});
  std::mt19937 engine(3);
  std::uniform_real_distribution<> some(0, 1);
  Reference reference, wanted;
  reference.motion = wanted.motion = Channels::kJoint;
  reference.joint.q = Vector7::Map(models::kHome.data());
  gate.reset(reference);
  double least = 1;
  HeldBy held = HeldBy::kNothing;
  for (int cycle = 0, until = 0; cycle < 200'000; ++cycle) {
    if (cycle == until) {
      until += 50 + static_cast<int>(600 * some(engine));
      for (int i = 0; i < models::kJoints; ++i) wanted.joint.q[i] = -1 + 2 * some(engine);
      wanted.joint.q[3] = limits.q_min[3] + some(engine);
      wanted.joint.q[5] = limits.q_min[5] + 2 * some(engine);
    }
    model.update(reference.joint.q, reference.joint.dq);
    gate.observe(reference, Vector7::Zero(), nullptr);
    held |= gate.follow(wanted, reference);
    least = std::min(least, self_distance(body, reference.joint.q).distance);
  }
  EXPECT_TRUE(has(held, HeldBy::kItself));
  EXPECT_GT(least, models::kCapsuleMargin + 5e-4) << "what the way looks like between its places";
}

// A reference that has slid along itself to where all that leads out comes nearer to begin with: it comes to rest there, and at
// whatever moment it is called back it finds the way.
TEST_P(FoldedArm, comes_out_of_a_pocket_of_itself) {
  constexpr int kIn = 1500, kRested = 350, kWay = 1000, kOut = 4000;  // cycles
  constexpr double kFrom = 1.4, kTo = 0.5;  // rad, of joint 6
  const models::Arm& arm = models::arm(GetParam());
  const models::Limits& limits = models::limits(arm, 10);
  const ArmCapsules body(arm, true);
  for (int moment = 0; moment < 400; moment += 10) {
    Model model(models::urdf(arm, 10));
    MotionGate gate(limits, model);
    delete gate.keep_from(new Walls{body, {}});
    Reference reference;
    reference.motion = Channels::kJoint;
    reference.joint.q << 0, -0.5, 0, -2.7, 0, kFrom, M_PI / 4;
    Reference wanted = reference;
    gate.reset(reference);
    double& q = reference.joint.q[5];
    for (int cycle = 0; cycle < kIn + moment + kOut; ++cycle) {
      const bool out = cycle >= kIn + moment;
      const double u = std::min((out ? cycle - kIn - moment : cycle) / static_cast<double>(kWay), 1.);
      const double way = (out ? -1 : 1) * (kTo - kFrom);
      wanted.joint.q[5] = (out ? kTo : kFrom) + way * u * u * u * (10 - 15 * u + 6 * u * u);
      wanted.joint.dq[5] = way * 30 * u * u * (1 - u) * (1 - u) / (kWay * kTick);
      wanted.joint.ddq[5] = way * 60 * u * (1 - u) * (1 - 2 * u) / (kWay * kTick * kWay * kTick);
      model.update(reference.joint.q, reference.joint.dq);
      gate.observe(reference, Vector7::Zero(), nullptr);
      gate.follow(wanted, reference);
      if (cycle == kIn - 1) {
        ASSERT_LT(q, 1);
      }
      if (!out && cycle == kIn + kRested) {
        EXPECT_LT(reference.joint.dq.norm(), 1e-3) << "rattles";
      }
    }
    EXPECT_NEAR(q, kFrom, 1e-6) << "called back " << moment << " cycles later";
  }
}

// Goals behind a plane that stands across them anyhow: where there is no way on, the reference rests, and does not rattle.
TEST_P(FoldedArm, rests_at_a_wall) {
  constexpr int kGoals = 25, kCycles = 5000;
  const models::Arm& arm = models::arm(GetParam());
  const models::Limits& limits = models::limits(arm, 10);
  std::mt19937 engine(3);
  std::uniform_real_distribution<> some(0, 1);
  int met = 0, rest = 0;
  for (int n = 0; n < kGoals; ++n) {
    Model model(models::urdf(arm, 10));
    MotionGate gate(limits, model);
    const double a = 2 * M_PI * some(engine);
    const Vector3 out(std::cos(a), std::sin(a), 0);
    delete gate.keep_from(new Walls{ArmCapsules(arm, true), {{1, plane(Vector3(0.15, 0, 0) - 0.1 * out, out)}}});
    Reference reference, wanted;
    reference.motion = wanted.motion = Channels::kJoint;
    reference.joint.q = Vector7::Map(models::kHome.data());
    for (int i = 0; i < models::kJoints; ++i) wanted.joint.q[i] = reference.joint.q[i] - 0.7 + 1.4 * some(engine);
    gate.reset(reference);
    HeldBy held = HeldBy::kNothing;
    for (int cycle = 0; cycle < kCycles; ++cycle) {
      model.update(reference.joint.q, reference.joint.dq);
      gate.observe(reference, Vector7::Zero(), nullptr);
      held = gate.follow(wanted, reference);
    }
    if (!has(held, HeldBy::kWall)) continue;
    ++met;
    rest += reference.joint.dq.norm() < 1e-3;
  }
  EXPECT_GT(met, kGoals / 2);
  EXPECT_GE(rest, met - 1) << "that slide on for longer than this";
}

// What it holds lies deep in another link, to which it is allowed: that is no leave for others.
TEST_P(FoldedArm, keeps_its_links_apart_whatever_else_lies_in_it) {
  const models::Arm& arm = models::arm(GetParam());
  const models::Limits& limits = models::limits(arm, 10);
  const ArmCapsules body(arm, true);
  ArmCapsules holding = body;
  ASSERT_TRUE(holding.hold({0, 0, -0.1}, {0, 0, -0.12}, 0.14));
  Model model(models::urdf(arm, 10));
  MotionGate gate(limits, model);
  delete gate.keep_from(new Walls{holding, {}});
  Reference reference, wanted;
  reference.motion = wanted.motion = Channels::kJoint;
  reference.joint.q = Vector7::Map(models::kHome.data());
  reference.joint.q[5] = 0.6;
  wanted.joint.q = reference.joint.q;
  wanted.joint.q[3] = limits.q_min[3] + 0.02;
  ASSERT_LT(self_distance(body, wanted.joint.q).distance, models::kCapsuleMargin);
  gate.reset(reference);
  double least = 1;
  for (int cycle = 0; cycle < 60'000; ++cycle) {
    model.update(reference.joint.q, reference.joint.dq);
    gate.observe(reference, Vector7::Zero(), nullptr);
    gate.follow(wanted, reference);
    least = std::min(least, self_distance(body, reference.joint.q).distance);
  }
  EXPECT_GT(least, models::kCapsuleMargin + 5e-4);
}

// Joint 1 on its way from one side to the other, and a plane across it.
class FastArm : public testing::TestWithParam<const char*> {
 protected:
  static constexpr int kMoves = 550;  // cycles, after which it goes as fast as it will

  // `cycles` towards the other side, then to rest with step(); returns how near it has come to where a plane at y (m) would be.
  template <class Step>
  double run(double y, Step step, bool wall = false) {
    MotionGate gate(limits, model);
    Reference reference, wanted;
    reference.motion = wanted.motion = Channels::kJoint;
    reference.joint.q = wanted.joint.q = Vector7::Map(models::kHome.data());
    reference.joint.q[0] = -0.6;
    wanted.joint.q[0] = 1.5;
    const Walls walls{ArmCapsules(arm, true), {{1, plane({0, y, 0}, -Vector3::UnitY())}}};
    delete gate.keep_from(new Walls(wall ? walls : Walls{walls.arm, {}}));
    gate.reset(reference);
    double least = 1e9;
    for (int cycle = 0; cycle < 3000; ++cycle) {
      model.update(reference.joint.q, reference.joint.dq);
      gate.observe(reference, Vector7::Zero(), nullptr);
      if (cycle == 0 || !step(cycle, gate, walls, reference)) gate.follow(wanted, reference);
      least = std::min(least, clearance_of(walls, reference.joint.q));
    }
    return least;
  }

  const models::Arm& arm = models::arm(GetParam());
  const models::Limits& limits = models::limits(arm, 10);
  Model model{models::urdf(arm, 10)};
};
INSTANTIATE_TEST_SUITE_P(Arms, FastArm, testing::Values("fer", "fr3"), [](const auto& info) { return std::string(info.param); });

TEST_P(FastArm, brakes_as_soon_as_may_be_for_a_wall_that_comes) {
  const double rests = -run(0, [](int cycle, MotionGate& gate, const Walls&, Reference& reference) {
    return cycle >= kMoves && (gate.brake(reference, true), true);
  });
  const double gently = -run(0, [](int cycle, MotionGate& gate, const Walls&, Reference& reference) {
    return cycle >= kMoves && (gate.brake(reference), true);
  });
  EXPECT_GT(gently, rests + 0.005);
  for (const bool is_braking : {false, true}) {
    const double least = run(rests + 0.008, [&](int cycle, MotionGate& gate, const Walls& walls, Reference& reference) {
      if (cycle == kMoves) delete gate.keep_from(new Walls(walls));
      return is_braking && cycle >= kMoves && (gate.brake(reference), true);
    });
    EXPECT_GT(least, 0.0075) << is_braking;
  }
}

// Wherever a skill takes the motion over while it brakes for a wall: it goes on as on the way that was clear.
TEST_P(FastArm, goes_on_braking_when_another_takes_over) {
  for (int after = 0; after < 8; ++after) {
    int met = -1;
    const double least = run(0.3, [&](int cycle, MotionGate& gate, const Walls&, Reference& reference) {
      if (met >= 0 && cycle == met + after) gate.reset(reference);
      Reference goal = reference;
      goal.joint = {Vector7::Map(models::kHome.data()), Vector7::Zero(), Vector7::Zero()};
      goal.joint.q[0] = 1.5;
      if (has(gate.follow(goal, reference), HeldBy::kWall) && met < 0) met = cycle;
      return true;
    }, true);
    EXPECT_GE(met, 0);
    EXPECT_GT(least, 0.009) << after;
  }
}

class FastPose : public LoadedArm {};
INSTANTIATE_TEST_SUITE_P(Arms, FastPose, testing::Values("fer", "fr3"), [](const auto& info) { return std::string(info.param); });

// As a skill by poses may take over from joints that move at up to their greatest speed, with an arm that has stayed behind them: out
// of reach, past singular postures and the ends of joints, where those that would follow it are no measure.
TEST_P(FastPose, comes_to_rest_from_wherever_it_begins) {
  double longest = 0, farthest = 0;
  for (int n = 0; n < 300; ++n) {
    Vector7 q, dq, behind;
    for (int i = 0; i < 7; ++i) {
      q[i] = limits.q_min[i] + (0.02 + 0.96 * share(random)) * (limits.q_max[i] - limits.q_min[i]);
      dq[i] = 0.7 * share(random) * (share(random) < 0.5 ? limits.dq_lower(i, q[i]) : limits.dq_upper(i, q[i]));
      behind[i] = q[i] - 0.1 * share(random) * dq[i];
    }
    model.update(q, dq);
    Reference reference;
    reference.motion = Channels::kPose;
    reference.cartesian = at(model.O_T_EE());
    reference.cartesian.velocity = model.jacobian() * dq;
    const Vector3 start = reference.cartesian.position;
    model.update(behind, dq);
    MotionGate gate(limits, model);
    gate.place(behind);
    gate.reset(reference);
    double time = 0;
    for (bool rests = false; !rests && time < 30; time += kTick) {
      gate.observe(reference, Vector7::Zero(), nullptr);
      rests = gate.brake(reference);
    }
    longest = std::max(longest, time);
    farthest = std::max(farthest, (reference.cartesian.position - start).norm());
  }
  EXPECT_LT(longest, 2);
  EXPECT_LT(farthest, 1);
}

class PoseOutOfReach : public testing::TestWithParam<std::tuple<const char*, Eigen::Vector3d>> {};

std::string names(const testing::TestParamInfo<PoseOutOfReach::ParamType>& info) {
  return std::get<0>(info.param) + std::to_string(info.index);
}
INSTANTIATE_TEST_SUITE_P(Arms, PoseOutOfReach,
                         testing::Combine(testing::Values("fer", "fr3"),
                                          testing::Values(Eigen::Vector3d(1.9, 0, 0.4), Eigen::Vector3d(0.8, 0, 0.4),
                                                          Eigen::Vector3d(0.3, 0.9, 0.3), Eigen::Vector3d(0.3, 0, 1.6))),
                         names);

// Out as far as it goes, again and again, and home: the joints go along as fast as they may and no faster.
TEST_P(PoseOutOfReach, is_gone_to_as_far_as_joints_reach_and_left_again) {
  const auto& [name, place] = GetParam();
  Following arm(models::arm(name));
  Reference out = arm.home;
  out.cartesian.position = place;
  const auto go = [&](const Reference& wanted, int most) {
    for (int k = 0; k < most; ++k) {
      if ((arm.reference.cartesian.position - wanted.cartesian.position).norm() < 1e-4) return;
      ASSERT_LT(arm.follow(wanted), 1.5) << k;
    }
  };
  for (int n = 0; n < 2; ++n) {
    go(out, 15'000);
    EXPECT_GT(arm.way().norm(), 0.15) << n;
    EXPECT_LT((arm.model.O_T_EE(arm.q).translation() - arm.reference.cartesian.position).norm(), 0.04) << n;
    go(arm.home, 60'000);  // from the end of its reach it leaves slowly
    EXPECT_LT(arm.way().norm(), 1e-3) << n;
    EXPECT_LT((arm.model.O_T_EE(arm.q).translation() - arm.home.cartesian.position).norm(), 2e-3) << n;
  }
}

// arm, whether the robot makes the joints, and the share of the arm's speed that what is wanted moves with
class StreamOutOfReach : public testing::TestWithParam<std::tuple<const char*, bool, double>> {};

INSTANTIATE_TEST_SUITE_P(Arms, StreamOutOfReach,
                         testing::Combine(testing::Values("fer", "fr3"), testing::Bool(), testing::Values(1, 0.1)),
                         [](const auto& info) {
                           return std::string(std::get<0>(info.param)) + (std::get<1>(info.param) ? "_robots_" : "_ours_") +
                                  std::to_string(info.index);
                         });

// A stream of places, from home.
struct Streaming {
  Streaming(Following& arm, double speed) : arm(arm), stream({"pose", 0., 0., speed}, arm.limits) {
    stream.start(arm.home);
    const Eigen::Quaterniond& turn = arm.home.cartesian.orientation;
    Eigen::Vector4d::Map(&sample.values[5]) << turn.w(), turn.x(), turn.y(), turn.z();
  }

  void send(const Vector3& place) {
    Vector3::Map(&sample.values[2]) = place;
    stream.sensor_inputs().front()->put(sample);
  }

  void cycle() {
    now.time += kTick;
    stream.step(now, now.time, wanted);
    arm.follow(wanted);
  }

  Following& arm;
  StreamPose stream;
  SensorSample sample;  // a PosePositionSensorMessage
  const fci::RobotState state{};
  Cycle now{.state = state, .model = arm.model};
  Reference wanted;
};

// What is wanted goes on out there, and comes back by and by: it is waited for, and not passed where it stops.
TEST_P(StreamOutOfReach, is_come_back_with_and_not_passed) {
  const auto& [name, robots, speed] = GetParam();
  Following arm(models::arm(name), robots);
  Streaming to(arm, speed);
  for (const Vector3& place : {Vector3(1.9, 0, 0.4), Vector3(1.9, 0, 0.4), Vector3(0.4, 0, 1.6), Vector3(0.8, 0, 0.2)}) {
    to.send(place);
    for (int k = 0; k < 6000; ++k) to.cycle();
    const Vector3 out = arm.way();
    EXPECT_GT(out.norm(), 0.15) << place.transpose();
    to.send(arm.home.cartesian.position);
    for (int k = 0; k < 40'000 && arm.way().norm() > 0.01; ++k) {
      to.cycle();
      ASSERT_GT(arm.way().dot(out.normalized()), -0.02) << place.transpose() << ", cycle " << k;
    }
    EXPECT_LE(arm.way().norm(), 0.01) << place.transpose();
  }
}

class PoseAlongWall : public testing::TestWithParam<std::tuple<const char*, bool>> {};
INSTANTIATE_TEST_SUITE_P(Arms, PoseAlongWall, testing::Combine(testing::Values("fer", "fr3"), testing::Bool()), [](const auto& info) {
  return std::string(std::get<0>(info.param)) + (std::get<1>(info.param) ? "_robots" : "_ours");
});

// Whichever way it comes, and however fast.
TEST_P(PoseAlongWall, comes_no_nearer) {
  const auto& [name, robots] = GetParam();
  double worst = 1e9;
  std::mt19937 engine(5);
  std::normal_distribution<> some;
  const auto direction = [&] { return Vector3(some(engine), some(engine), some(engine)).normalized(); };
  for (int n = 0; n < 60; ++n) {
    Following arm(models::arm(name), robots);
    const Vector3 way = direction(), normal = (direction() + 0.7 * way).normalized();
    if (way.dot(normal) < 0.2) continue;
    const double speed = 0.5 + 0.1 * (n % 5), ahead = 0.05 + 0.05 * (n % 7);
    Walls walls{ArmCapsules(models::arm(name), true), {{1, plane(Vector3::Zero(), -normal)}}};
    walls.walls[0].shape.O_T_S.translation() = (ahead - clearance_of(walls, arm.q)) * normal;
    delete arm.gate.keep_from(new Walls(walls));
    Reference wanted = arm.home;
    double least = 1e9;
    for (int k = 0; k < 1200; ++k) {
      wanted.cartesian.position += kTick * speed * way;
      wanted.cartesian.velocity.head<3>() = speed * way;
      arm.follow(wanted);
      least = std::min(least, clearance_of(walls, arm.q));
    }
    worst = std::min(worst, least);
  }
  EXPECT_GT(worst, 0.009);
}

class RobotOutOfReach : public testing::TestWithParam<const char*> {};

INSTANTIATE_TEST_SUITE_P(Arms, RobotOutOfReach, testing::Values("fer", "fr3"), [](const auto& info) { return info.param; });

// From place to place at the end of its reach, where the slowest motion of a pose is one of the joints: those that a robot makes,
// which damps nothing there, keep to what they may do.
TEST_P(RobotOutOfReach, keeps_its_joints_accelerations) {
  Following arm(models::arm(GetParam()), true);
  Streaming to(arm, 1);
  for (const Vector3& place : {Vector3(0.7, -0.65, 1.2), Vector3(0.95, -0.57, 0.8), Vector3(0.25, 0.8, 0.8), Vector3(0.97, 0.73, -0.2)}) {
    for (const Vector3& next : {place, Vector3(arm.home.cartesian.position)}) {
      to.send(next);
      for (int k = 0; k < 7000; ++k) {
        to.cycle();
        ASSERT_LT(arm.ddq.cwiseAbs().cwiseQuotient(Vector7::Map(arm.limits.ddq_max.data())).maxCoeff(), 1)
            << next.transpose() << ", cycle " << k;
      }
    }
  }
}

// A pose that slows, as its joints grow faster next to a singular posture, is not braked less for something that is in the way: then
// nothing would hold them. An FR3 that was there.
TEST(RobotNextToSingularPosture, comes_to_rest_when_it_is_braked) {
  Following arm(models::arm("fr3"), true);
  arm.q << -1.42634, -0.98142, 0.97413, -2.02639, 0.3456, 1.15228, 0.25415;
  arm.model.update(arm.q, Vector7::Zero());
  arm.reference.cartesian = at(arm.model.O_T_EE());
  const Vector6 P = (Vector6() << -0.02361, -0.06872, -0.0121, 0.01477, 0.03068, -0.07096).finished();
  arm.reference.cartesian.velocity = P;
  arm.reference.cartesian.acceleration = -8.5 * P;
  arm.dq = arm.model.joints_of_pose(arm.q, Model::kNoDamping).dq_dP * P;
  arm.gate.place(arm.q);
  arm.gate.reset(arm.reference);
  double most = 0;
  bool rests = false;
  for (int k = 0; k < 300; ++k) {
    rests = arm.brake();
    if (k > 2) most = std::max(most, arm.ddq.cwiseAbs().cwiseQuotient(Vector7::Map(arm.limits.ddq_max.data())).maxCoeff());
  }
  EXPECT_TRUE(rests);
  EXPECT_LT(most, 1.1);
}

}  // namespace
