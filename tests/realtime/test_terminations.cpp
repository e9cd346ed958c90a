#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>

#include "allocation_counter.hpp"
#include "realtime/rotation.hpp"
#include "realtime/terminations/final_joint.hpp"
#include "realtime/terminations/final_pose.hpp"
#include "realtime/terminations/time.hpp"
#include "realtime/trajectories/min_jerk_joint.hpp"
#include "realtime/trajectories/min_jerk_pose.hpp"
#include "simulated_arm.hpp"

namespace {

using realtime::FinalJoint;
using realtime::FinalPose;
using realtime::MinJerkJoint;
using realtime::MinJerkPose;
using realtime::Progress;
using realtime::Reference;
using realtime::ReferenceKind;
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

TEST_F(Terminations, final_joint_looks_at_every_commanded_joint) {
  FinalJoint final({Vector7::Constant(1e-3)});
  EXPECT_TRUE(final.accepts(ReferenceKind::kJoint));
  EXPECT_FALSE(final.accepts(ReferenceKind::kCartesian));
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

TEST_F(Terminations, final_pose_looks_at_the_measured_pose) {
  const Vector3 position = arm.cycle.O_T_EE.translation();
  const Eigen::Quaterniond orientation(arm.cycle.O_T_EE.linear());
  FinalPose final({Vector3(1e-3, 2e-3, 3e-3), 0.01});
  EXPECT_FALSE(final.accepts(ReferenceKind::kJoint));
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

std::string refusal(const std::function<void()>& construct) {
  try {
    construct();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
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
  expect(refusal([] { Time({{}, {}}); }), "neither");
  expect(refusal([] { Time({1.0, 1.0}); }), "both");
}

TEST_F(Terminations, step_allocates_nothing) {
  if (!testing_tools::kCountsAllocations) GTEST_SKIP() << "the heap belongs to a sanitizer";
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
