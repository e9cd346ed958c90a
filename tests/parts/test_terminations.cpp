#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>

#include "realtime/momentum_observer.hpp"
#include "realtime/rotation.hpp"
#include "realtime/terminations/composite.hpp"
#include "realtime/terminations/contact.hpp"
#include "realtime/terminations/final_joint.hpp"
#include "realtime/terminations/final_pose.hpp"
#include "realtime/terminations/moved.hpp"
#include "realtime/terminations/never.hpp"
#include "realtime/terminations/outside_box.hpp"
#include "realtime/terminations/sensor_says.hpp"
#include "realtime/terminations/time.hpp"
#include "realtime/terminations/velocity_below.hpp"
#include "realtime/terminations/wrench_above.hpp"
#include "realtime/trajectories/min_jerk_joint.hpp"
#include "realtime/trajectories/min_jerk_pose.hpp"
#include "tests/parts/refusal.hpp"
#include "tests/realtime/allocation_counter.hpp"
#include "tests/realtime/simulated_arm.hpp"

namespace {

using realtime::FinalJoint;
using realtime::FinalPose;
using realtime::MinJerkJoint;
using realtime::MinJerkPose;
using realtime::Progress;
using realtime::Reference;
using realtime::Channels;
using realtime::Time;
using realtime::Vector3;
using realtime::Vector7;

class Terminations : public testing::Test {
 protected:
  testing_tools::SimulatedArm arm{"fer"};
  const models::Limits& limits = models::limits(models::arm("fer"), 5);
  Vector7 goal_q = Vector7::Map(models::kHome.data());
  MinJerkJoint joints{{goal_q, 1}, limits};
  Reference reference;
};

TEST_F(Terminations, time_ends_at_its_time_of_the_skill) {
  Time time({0.5, {}});
  time.start();
  const Progress progress{joints, false, reference};
  int cycles = 0;
  for (arm.cycle.time = 0; !time.step(arm.cycle, progress); arm.cycle.time += 0.001) ++cycles;
  EXPECT_EQ(cycles, 500);
}

TEST_F(Terminations, time_after_the_trajectory_counts_from_its_end_wherever_that_is) {
  for (const int over_at : {0, 700, 1234}) {
    Time time({{}, 0.2});
    time.start();
    int ms = 0;
    for (;; ++ms) {
      arm.cycle.time = ms * 0.001;
      const Progress progress{joints, ms >= over_at, reference};
      if (time.step(arm.cycle, progress)) break;
    }
    EXPECT_EQ(ms, over_at + 200);
  }
}

TEST_F(Terminations, all_of_them_end_as_softly_as_a_contact_among_them) {
  const auto all = [](bool contact) {
    realtime::Terminations parts;
    parts.push_back(std::make_unique<Time>(Time::Parameters{1, {}}));
    if (contact) parts.push_back(std::make_unique<realtime::Contact>(realtime::Contact::Parameters{true, true, {}, {}}));
    return realtime::AllOf(std::move(parts));
  };
  EXPECT_NE(all(true).then(), nullptr);
  EXPECT_EQ(all(false).then(), nullptr);
}

TEST_F(Terminations, what_a_sensor_says_is_not_lost_among_other_messages) {
  realtime::SensorSays says("topic");
  const auto input = says.sensor_inputs().at(0);
  const Progress progress{joints, false, reference};
  const auto put = [&](bool end, int times) {
    realtime::SensorSample sample;
    sample.values[1] = end ? 1 : 0;
    for (int i = 0; i < times; ++i) input->put(sample);
  };
  put(false, 1000);
  EXPECT_FALSE(says.step(arm.cycle, progress));
  put(true, 1);
  put(false, 1000);
  EXPECT_TRUE(says.step(arm.cycle, progress));
  EXPECT_TRUE(says.step(arm.cycle, progress)) << "it stays said";
}

TEST_F(Terminations, final_joint_looks_at_every_commanded_joint) {
  FinalJoint final({Vector7::Constant(1e-3)});
  EXPECT_EQ(final.judges(), Channels::kJoint);
  const Progress progress{joints, false, reference};
  reference.joint.q = goal_q;
  EXPECT_TRUE(final.step(arm.cycle, progress));
  for (int i = 0; i < 7; ++i) {
    for (const double way : {-1.0, 1.0}) {
      reference.joint.q = goal_q;
      reference.joint.q[i] += way * 0.9e-3;
      EXPECT_TRUE(final.step(arm.cycle, progress));
      reference.joint.q[i] += way * 0.2e-3;
      EXPECT_FALSE(final.step(arm.cycle, progress));
    }
  }
}

TEST_F(Terminations, final_joint_looks_at_the_arm_if_it_is_told_to) {
  FinalJoint final({Vector7::Constant(1e-3), realtime::Judged::kArm});
  const Progress progress{joints, false, reference};
  reference.joint.q = goal_q;
  arm.cycle.q = goal_q + Vector7::Constant(2e-3);
  EXPECT_FALSE(final.step(arm.cycle, progress));
  arm.cycle.q = goal_q;
  reference.joint.q.setZero();
  EXPECT_TRUE(final.step(arm.cycle, progress));
}

TEST_F(Terminations, final_pose_looks_at_reference_or_arm) {
  const Eigen::Isometry3d here = arm.cycle.O_T_EE;
  const MinJerkPose pose({here.translation(), Eigen::Quaterniond(here.linear()), 1}, limits);
  FinalPose of_arm({Vector3::Constant(1e-3), 0.01, realtime::Judged::kArm}), of_reference({Vector3::Constant(1e-3), 0.01});
  reference.motion = Channels::kPose;
  reference.cartesian = realtime::at(here);
  const Progress progress{pose, false, reference};
  arm.cycle.O_T_EE.translation().x() += 2e-3;
  EXPECT_FALSE(of_arm.step(arm.cycle, progress));
  EXPECT_TRUE(of_reference.step(arm.cycle, progress));
  arm.cycle.O_T_EE = here;
  reference.cartesian.orientation = realtime::exp(0.02 * Vector3::UnitX()) * reference.cartesian.orientation;
  EXPECT_TRUE(of_arm.step(arm.cycle, progress));
  EXPECT_FALSE(of_reference.step(arm.cycle, progress));
}

TEST_F(Terminations, final_pose_looks_at_each_axis_and_the_angle) {
  const Vector3 position = arm.cycle.O_T_EE.translation();
  const Eigen::Quaterniond orientation(arm.cycle.O_T_EE.linear());
  FinalPose final({Vector3(1e-3, 2e-3, 3e-3), 0.01, realtime::Judged::kArm});
  EXPECT_EQ(final.judges(), Channels::kPose);
  const auto ends = [&](const Vector3& p, const Eigen::Quaterniond& R) {
    const MinJerkPose pose({p, R, 1}, limits);
    return final.step(arm.cycle, Progress{pose, false, reference});
  };
  EXPECT_TRUE(ends(position, orientation));
  for (int i = 0; i < 3; ++i) {
    EXPECT_TRUE(ends(position + 0.9e-3 * (i + 1) * Vector3::Unit(i), orientation));
    EXPECT_FALSE(ends(position + 1.1e-3 * (i + 1) * Vector3::Unit(i), orientation));
    EXPECT_TRUE(ends(position, realtime::exp(0.009 * Vector3::Unit(i)) * orientation));
    EXPECT_FALSE(ends(position, realtime::exp(0.011 * Vector3::Unit(i)) * orientation));
    EXPECT_FALSE(ends(position, realtime::exp(M_PI * Vector3::Unit(i)) * orientation));
  }
  Eigen::Quaterniond same = orientation;
  same.coeffs() *= -1;
  EXPECT_TRUE(ends(position, same));
}

TEST_F(Terminations, contact_looks_at_the_flags_that_it_was_told_to) {
  const Progress progress{joints, false, reference};
  realtime::Contact cartesian({true, false, {}, {}}), joint({false, true, {}, {}}), both({true, true, {}, {}});
  const auto ends = [&](realtime::Contact& contact) { return contact.step(arm.cycle, progress); };
  EXPECT_FALSE(ends(both));
  arm.state.cartesian_contact[4] = 1;
  EXPECT_TRUE(ends(cartesian));
  EXPECT_FALSE(ends(joint));
  EXPECT_TRUE(ends(both));
  arm.state.cartesian_contact[4] = 0;
  arm.state.joint_contact[6] = 1;
  EXPECT_FALSE(ends(cartesian));
  EXPECT_TRUE(ends(joint));
}

TEST_F(Terminations, contact_with_thresholds_looks_at_each_component_of_the_estimates) {
  const Progress progress{joints, false, reference};
  const realtime::Vector6 force = (realtime::Vector6() << 5, 6, 7, 1, 2, 3).finished();
  const Vector7 torque = (Vector7() << 1, 2, 3, 4, 5, 6, 7).finished();
  realtime::Contact cartesian({true, false, force, {}}), joint({false, true, {}, torque}), both({true, true, force, torque});
  const auto ends = [&](realtime::Contact& contact) { return contact.step(arm.cycle, progress); };
  arm.state.cartesian_contact.fill(1);  // the robot's flags are of its own thresholds
  arm.state.joint_contact.fill(1);
  EXPECT_FALSE(ends(both));
  for (const double sign : {-1.0, 1.0}) {
    for (std::size_t i = 0; i < 6; ++i) {
      double& felt = arm.state.O_F_ext_hat_K[i];
      felt = sign * (force[static_cast<Eigen::Index>(i)] - 0.1);
      EXPECT_FALSE(ends(both)) << i;
      felt = sign * (force[static_cast<Eigen::Index>(i)] + 0.1);
      EXPECT_TRUE(ends(cartesian)) << i;
      EXPECT_TRUE(ends(both)) << i;
      EXPECT_FALSE(ends(joint)) << i;
      felt = 0;
    }
    for (std::size_t i = 0; i < 7; ++i) {
      double& felt = arm.state.tau_ext_hat_filtered[i];
      felt = sign * (torque[static_cast<Eigen::Index>(i)] - 0.1);
      EXPECT_FALSE(ends(both)) << i;
      felt = sign * (torque[static_cast<Eigen::Index>(i)] + 0.1);
      EXPECT_TRUE(ends(joint)) << i;
      EXPECT_TRUE(ends(both)) << i;
      EXPECT_FALSE(ends(cartesian)) << i;
      felt = 0;
    }
  }
}

TEST_F(Terminations, time_after_a_trajectory_that_begins_anew_counts_anew) {
  realtime::Time time({std::nullopt, 1.0});
  time.start();
  arm.cycle.time = 5;
  EXPECT_FALSE(time.step(arm.cycle, Progress{joints, true, reference}));
  arm.cycle.time = 5.9;
  EXPECT_FALSE(time.step(arm.cycle, Progress{joints, true, reference}));
  Progress anew{joints, false, reference};
  anew.began = 5.9;
  arm.cycle.time = 6.5;
  EXPECT_FALSE(time.step(arm.cycle, anew));
  anew.trajectory_over = true;
  arm.cycle.time = 7;
  EXPECT_FALSE(time.step(arm.cycle, anew));
  arm.cycle.time = 8;
  EXPECT_TRUE(time.step(arm.cycle, anew));
}

TEST_F(Terminations, contact_by_the_observer_looks_at_its_estimates_alone) {
  Progress progress{joints, false, reference};
  using Estimate = realtime::Contact::Estimate;
  const realtime::Vector6 most = realtime::MomentumObserver::kForceThresholds;
  realtime::Contact usual({true, true, {}, {}, Estimate::kObserver}), own({true, false, 0.5 * most, {}, Estimate::kObserver});
  const auto ends = [&](realtime::Contact& contact) { return contact.step(arm.cycle, progress); };
  arm.state.cartesian_contact.fill(1);
  arm.state.O_F_ext_hat_K.fill(100);
  arm.state.tau_ext_hat_filtered.fill(100);
  EXPECT_FALSE(ends(usual) || ends(own));
  progress.O_F_ext_K[1] = -0.9 * most[1];
  EXPECT_FALSE(ends(usual));
  EXPECT_TRUE(ends(own));
  progress.O_F_ext_K[1] = -1.1 * most[1];
  EXPECT_TRUE(ends(usual));
  progress.O_F_ext_K.setZero();
  progress.tau_ext = 1.1 * realtime::MomentumObserver::kTorqueThresholds;
  EXPECT_TRUE(ends(usual));
  EXPECT_FALSE(ends(own));
}

TEST_F(Terminations, thresholds_of_contact_that_are_not_given_are_those_published) {
  const Progress progress{joints, false, reference};
  realtime::Contact only_torque({true, true, {}, Vector7(Vector7::Constant(50))});
  realtime::Contact only_force({true, true, realtime::Vector6(realtime::Vector6::Constant(50)), {}});
  const auto ends = [&](realtime::Contact& contact) { return contact.step(arm.cycle, progress); };
  arm.state.O_F_ext_hat_K[5] = 24.9;
  EXPECT_FALSE(ends(only_torque));
  arm.state.O_F_ext_hat_K[5] = 25.1;
  EXPECT_TRUE(ends(only_torque));
  EXPECT_FALSE(ends(only_force));
  arm.state.tau_ext_hat_filtered[6] = -11.9;
  EXPECT_FALSE(ends(only_force));
  arm.state.tau_ext_hat_filtered[6] = -12.1;
  EXPECT_TRUE(ends(only_force));
}

TEST_F(Terminations, wrench_is_judged_along_its_axis_or_by_its_size) {
  using realtime::WrenchAbove;
  const Progress progress{joints, false, reference};
  arm.state.O_F_ext_hat_K = {3, 0, -4, 0, 1, 0};
  arm.state.K_F_ext_hat_K = {9, 0, 0, 2, 0, 0};
  const auto ends = [&](WrenchAbove::Part part, double threshold, std::optional<Vector3> axis, WrenchAbove::Frame frame) {
    WrenchAbove wrench({part, threshold, axis, frame, false});
    wrench.start();
    return wrench.step(arm.cycle, progress);
  };
  constexpr auto kForce = WrenchAbove::Part::kForce, kTorque = WrenchAbove::Part::kTorque;
  constexpr auto kBase = WrenchAbove::Frame::kBase, kStiffness = WrenchAbove::Frame::kStiffness;
  EXPECT_TRUE(ends(kForce, 4.9, {}, kBase));
  EXPECT_FALSE(ends(kForce, 5.1, {}, kBase));
  EXPECT_TRUE(ends(kForce, 3.9, Vector3(0, 0, 7), kBase));
  EXPECT_FALSE(ends(kForce, 4.1, Vector3(0, 0, -1), kBase));
  EXPECT_FALSE(ends(kForce, 0.1, Vector3(0, 1, 0), kBase));
  EXPECT_TRUE(ends(kForce, 8.9, {}, kStiffness));
  EXPECT_FALSE(ends(kTorque, 1.1, {}, kBase));
  EXPECT_TRUE(ends(kTorque, 1.1, {}, kStiffness));
}

TEST_F(Terminations, a_relative_wrench_counts_from_the_beginning_of_each_skill) {
  using realtime::WrenchAbove;
  const Progress progress{joints, false, reference};
  WrenchAbove force({WrenchAbove::Part::kForce, 5, Vector3(0, 0, 1), WrenchAbove::Frame::kBase, true});
  for (const double bias : {20.0, -3.0}) {
    force.start();
    arm.state.O_F_ext_hat_K[2] = bias;
    EXPECT_FALSE(force.step(arm.cycle, progress));
    arm.state.O_F_ext_hat_K[2] = bias - 4.9;
    EXPECT_FALSE(force.step(arm.cycle, progress));
    arm.state.O_F_ext_hat_K[2] = bias - 5.1;
    EXPECT_TRUE(force.step(arm.cycle, progress));
  }
}

TEST_F(Terminations, moved_measures_from_where_the_skill_began) {
  const Progress progress{joints, false, reference};
  const Eigen::Isometry3d home = arm.cycle.O_T_EE;
  realtime::Moved far({0.1, {}}), turned({{}, 0.5}), either({0.1, 0.5});
  const auto ends = [&](realtime::Moved& moved, double way, double angle) {
    arm.cycle.O_T_EE = home;
    moved.start();
    EXPECT_FALSE(moved.step(arm.cycle, progress));
    arm.cycle.O_T_EE.translation() += way * Vector3(2, -1, 2) / 3;
    arm.cycle.O_T_EE.linear() = (realtime::exp(angle * Vector3(2, -1, 2) / 3) * Eigen::Quaterniond(home.linear())).matrix();
    return moved.step(arm.cycle, progress);
  };
  EXPECT_TRUE(ends(far, 0.101, 0));
  EXPECT_FALSE(ends(far, 0.099, 3));
  EXPECT_TRUE(ends(turned, 0, 0.501));
  EXPECT_FALSE(ends(turned, 1, 0.499));
  EXPECT_TRUE(ends(either, 0.101, 0));
  EXPECT_TRUE(ends(either, 0, 0.501));
  EXPECT_FALSE(ends(either, 0.099, 0.499));
}

TEST_F(Terminations, outside_box_looks_at_each_side) {
  const Progress progress{joints, false, reference};
  realtime::OutsideBox box({Vector3(0.2, -0.3, 0.1), Vector3(0.6, 0.3, 0.7)});
  const auto ends = [&](const Vector3& p) {
    arm.cycle.O_T_EE.translation() = p;
    return box.step(arm.cycle, progress);
  };
  const Vector3 inside(0.4, 0, 0.4);
  EXPECT_FALSE(ends(inside));
  for (int i = 0; i < 3; ++i) {
    for (const double way : {-1.0, 1.0}) EXPECT_TRUE(ends(inside + way * Vector3::Unit(i)));
  }
}

TEST_F(Terminations, velocity_below_waits_for_rest_that_lasts) {
  const Progress progress{joints, false, reference};
  realtime::VelocityBelow slow({0.01, 0.1, 0.5});
  slow.start();
  int ms = 0;
  for (;; ++ms) {
    arm.cycle.time = ms * 0.001;
    const bool moving = ms >= 550 && ms < 600;  // it begins to count anew
    arm.cycle.dq = moving ? Vector7(0.02 * Vector7::Unit(3)) : Vector7(Vector7::Constant(-0.009));
    if (slow.step(arm.cycle, progress)) break;
  }
  EXPECT_EQ(ms, 699);
}

TEST_F(Terminations, composites_ask_all_of_their_parts_every_time) {
  const auto parts = [](double first, double second) {
    realtime::Terminations parts;
    parts.push_back(std::make_unique<Time>(Time::Parameters{first, {}}));
    parts.push_back(std::make_unique<Time>(Time::Parameters{{}, second}));  // has to see the end of the trajectory
    return parts;
  };
  const auto end_of = [&](realtime::Termination& termination) {
    termination.start();
    int ms = 0;
    for (;; ++ms) {
      arm.cycle.time = ms * 0.001;
      if (termination.step(arm.cycle, Progress{joints, ms >= 100, reference})) return ms;
    }
  };
  realtime::AnyOf any(parts(0.2, 0.3));
  realtime::AllOf all(parts(0.2, 0.3));
  EXPECT_EQ(end_of(any), 200);
  EXPECT_EQ(end_of(all), 400);
  realtime::Terminations of_joints;
  of_joints.push_back(std::make_unique<FinalJoint>(FinalJoint::Parameters{Vector7::Zero()}));
  of_joints.push_back(std::make_unique<realtime::Never>());
  const realtime::AllOf never(std::move(of_joints));
  EXPECT_EQ(never.judges(), Channels::kJoint);
}

TEST_F(Terminations, each_bad_field_is_refused_by_name) {
  const auto expect = [](const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  for (const double bad : {-1.0, std::nan(""), double{INFINITY}}) {
    expect(refusal([&] { Time({bad, {}}); }), "seconds is ");
    expect(refusal([&] { Time({{}, bad}); }), "after_trajectory is ");
    Vector7 threshold = Vector7::Zero();
    threshold[4] = bad;
    expect(refusal([&] { FinalJoint({threshold}); }), "threshold[4] is ");
    expect(refusal([&] { FinalPose({Vector3(0, bad, 0), 0}); }), "position_threshold[1] is ");
    expect(refusal([&] { FinalPose({Vector3::Zero(), bad}); }), "orientation_threshold is ");
  }
  using realtime::WrenchAbove;
  for (const double bad : {-1.0, std::nan(""), double{INFINITY}}) {
    const auto wrench = [&](double threshold, std::optional<Vector3> axis) {
      return refusal([&] { WrenchAbove({WrenchAbove::Part::kForce, threshold, axis, WrenchAbove::Frame::kBase, false}); });
    };
    expect(wrench(bad, {}), "threshold is ");
    if (bad != -1) expect(wrench(1, Vector3(0, bad, 0)), "norm of axis is ");
    expect(wrench(1, Vector3(0, 0, 0)), "norm of axis is ");
    expect(refusal([&] { realtime::Moved({bad, {}}); }), "distance is ");
    expect(refusal([&] { realtime::Moved({{}, bad}); }), "angle is ");
    expect(refusal([&] { realtime::VelocityBelow({bad, 1, 1}); }), "threshold is ");
    expect(refusal([&] { realtime::VelocityBelow({1, bad, 1}); }), "duration is ");
    expect(refusal([&] { realtime::VelocityBelow({1, 1, bad}); }), "after is ");
  }
  expect(refusal([] { realtime::Moved({{}, {}}); }), "neither");
  expect(refusal([] { realtime::Contact({false, false, {}, {}}); }), "nothing");
  realtime::Vector6 force = realtime::Vector6::Constant(10);
  force[4] = 126;
  expect(refusal([&] { realtime::Contact({true, false, force, {}}); }), "force_thresholds[4] is 126");
  expect(refusal([] { realtime::OutsideBox({Vector3(0, 1, 0), Vector3(1, 0, 1)}); }), "upper[1] is ");
  expect(refusal([] { Time({{}, {}}); }), "neither");
  expect(refusal([] { Time({1.0, 1.0}); }), "both");
}

TEST_F(Terminations, step_allocates_nothing) {
  if (!allocations::kCounts) GTEST_SKIP() << "the heap belongs to a sanitizer";
  Time time({{}, 0.2});
  FinalJoint final_joint({Vector7::Constant(1e-3)});
  FinalPose final_pose({Vector3::Constant(1e-3), 0.01});
  const Progress progress{joints, true, reference};
  const testing_tools::AllocationCounter allocations;
  for (realtime::Termination* kind :
       {static_cast<realtime::Termination*>(&time), static_cast<realtime::Termination*>(&final_joint),
        static_cast<realtime::Termination*>(&final_pose)}) {
    kind->start();
    kind->step(arm.cycle, progress);
  }
  EXPECT_EQ(allocations.count(), 0);
}

}  // namespace
