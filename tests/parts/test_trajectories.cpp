#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <string>

#include "models/arm.hpp"
#include "realtime/joint_range.hpp"
#include "realtime/limiter.hpp"
#include "realtime/rotation.hpp"
#include "realtime/trajectories/min_jerk_joint.hpp"
#include "realtime/trajectories/min_jerk_pose.hpp"
#include "realtime/trajectories/relative_min_jerk_joint.hpp"
#include "realtime/trajectories/relative_min_jerk_pose.hpp"
#include "tests/parts/refusal.hpp"
#include "tests/realtime/allocation_counter.hpp"
#include "tests/realtime/at_home.hpp"
#include "tests/realtime/dt.hpp"

namespace {

using realtime::MinJerkJoint;
using realtime::MinJerkPose;
using realtime::Reference;
using realtime::Channels;
using realtime::RelativeMinJerkJoint;
using realtime::RelativeMinJerkPose;
using realtime::Vector3;
using realtime::Vector6;
using realtime::Vector7;


class Trajectories : public testing::TestWithParam<const char*> {
 protected:
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  std::mt19937 random{42};
  double uniform(double low, double high) { return std::uniform_real_distribution<>(low, high)(random); }
  Vector3 direction() {
    std::normal_distribution<> normal;
    return Vector3(normal(random), normal(random), normal(random)).normalized();
  }
  Vector7 posture(double share) {
    Vector7 q;
    for (int i = 0; i < 7; ++i) {
      const double low = realtime::rest_min(limits, i), high = realtime::rest_max(limits, i);
      q[i] = (low + high) / 2 + uniform(-share, share) * (high - low) / 2;
    }
    return q;
  }
  Reference joints_at_rest() {
    Reference from;
    from.joint.q = posture(0.9);
    return from;
  }
  Reference joints_moving() {
    Reference from;
    from.joint.q = posture(0.4);
    for (int i = 0; i < 7; ++i) {
      const double room = std::min(limits.dq_upper(i, from.joint.q[i]), -limits.dq_lower(i, from.joint.q[i]));
      // Under FR3's envelope a decay at half of the acceleration needs a slower start.
      const double share = limits.envelope_deceleration[i] == 0 ? 0.7 : 0.4;
      from.joint.dq[i] = uniform(-share, share) * room;
      from.joint.ddq[i] = uniform(-0.6, 0.6) * limits.ddq_max[i];
    }
    return from;
  }
  Reference pose_at_rest() {
    Reference from;
    from.motion = Channels::kPose;
    from.cartesian.position = Vector3(0.5, 0, 0.4) + 0.2 * direction();
    from.cartesian.orientation = realtime::exp(uniform(0, 3.1) * direction());
    return from;
  }
  Reference pose_moving() {
    Reference from = pose_at_rest();
    from.cartesian.velocity << uniform(0, 0.8) * limits.translation.velocity * direction(),
        uniform(0, 0.8) * limits.rotation.velocity * direction();
    from.cartesian.acceleration << uniform(0, 0.6) * limits.translation.acceleration * direction(),
        uniform(0, 0.6) * limits.rotation.acceleration * direction();
    return from;
  }
};

INSTANTIATE_TEST_SUITE_P(Arms, Trajectories, testing::Values("fer", "fr3"),
                         [](const auto& info) { return std::string(info.param); });

double angle_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return 2 * std::atan2((a.conjugate() * b).vec().norm(), std::abs((a.conjugate() * b).w()));
}

TEST_P(Trajectories, from_rest_joints_follow_the_closed_form) {
  const Reference from = joints_at_rest();
  const Vector7 goal = posture(0.5);
  MinJerkJoint motion({goal, 8}, limits);
  motion.start(from);
  const double T = motion.duration();
  for (double s = 0; s <= 1; s += 0.05) {
    Reference at;
    EXPECT_EQ(motion.step(at_home(), s * T, at), s * T >= T);
    const double x = 10 * std::pow(s, 3) - 15 * std::pow(s, 4) + 6 * std::pow(s, 5);
    const double v = (30 * std::pow(s, 2) - 60 * std::pow(s, 3) + 30 * std::pow(s, 4)) / T;
    const double a = (60 * s - 180 * std::pow(s, 2) + 120 * std::pow(s, 3)) / T / T;
    const Vector7 way = goal - from.joint.q;
    EXPECT_LT((at.joint.q - (from.joint.q + x * way)).norm(), 1e-12);
    EXPECT_LT((at.joint.dq - v * way).norm(), 1e-12);
    EXPECT_LT((at.joint.ddq - a * way).norm(), 1e-12);
  }
}

TEST_P(Trajectories, a_duration_that_the_limits_allow_is_kept) {
  const Reference from = joints_at_rest();
  MinJerkJoint motion({from.joint.q + 0.1 * (posture(0.1) - from.joint.q), 20}, limits);
  motion.start(from);
  EXPECT_DOUBLE_EQ(motion.duration(), 20);
  EXPECT_DOUBLE_EQ(motion.stretch(), 1);

  MinJerkJoint fast({posture(0.1), 0.01}, limits);
  fast.start(from);
  EXPECT_GT(fast.stretch(), 5);
  EXPECT_NEAR(fast.duration(), 0.01 * fast.stretch(), 1e-9);
}

// Peaks of the motion from rest: no longer than the limits ask for.
TEST_P(Trajectories, a_stretched_motion_uses_the_limits) {
  Reference from;
  from.joint.q = (Vector7::Map(limits.q_min.data()) + Vector7::Map(limits.q_max.data())) / 2;
  for (const double way : {1e-3, 0.1, 0.9}) {
    MinJerkJoint motion({from.joint.q + Vector7::Constant(way), 0.001}, limits);
    motion.start(from);
    double used = 0;
    Reference at;
    for (int k = 0; k <= 1000; ++k) {
      motion.step(at_home(), motion.duration() * k / 1000, at);
      for (int i = 0; i < 7; ++i) {
        used = std::max({used, std::abs(at.joint.dq[i]) / limits.dq_upper(i, at.joint.q[i]),
                         std::abs(at.joint.ddq[i]) / limits.ddq_max[i]});
      }
    }
    used = std::max(used, 60 * way / std::pow(motion.duration(), 3) /
                              *std::min_element(limits.dddq_max.begin(), limits.dddq_max.end()));
    EXPECT_GT(used, 0.85) << "way of " << way;
    EXPECT_LE(used, 1) << "way of " << way;
  }
}

TEST_P(Trajectories, joints_begin_at_the_reference_with_its_velocity_and_acceleration_and_end_at_rest) {
  for (int n = 0; n < 200; ++n) {
    const Reference from = joints_moving();
    const Vector7 goal = posture(0.9);
    MinJerkJoint motion({goal, uniform(0.001, 3)}, limits);
    motion.start(from);
    Reference at;
    EXPECT_FALSE(motion.step(at_home(), 0, at));
    EXPECT_LT((at.joint.q - from.joint.q).norm(), 1e-12);
    EXPECT_LT((at.joint.dq - from.joint.dq).norm(), 1e-9);
    EXPECT_LT((at.joint.ddq - from.joint.ddq).norm(), 1e-6);
    // Nothing jumps at the end either.
    EXPECT_FALSE(motion.step(at_home(), motion.duration() - 1e-9, at));
    EXPECT_LT((at.joint.q - goal).norm(), 1e-8);
    EXPECT_LT(at.joint.dq.norm(), 1e-4);
    EXPECT_LT(at.joint.ddq.norm(), 1e-2);
    EXPECT_TRUE(motion.step(at_home(), motion.duration(), at));
    EXPECT_EQ(at.joint.q, goal);
    EXPECT_EQ(at.joint.q, motion.goal().joint.q);
    EXPECT_EQ(at.joint.dq, Vector7::Zero());
    EXPECT_EQ(at.joint.ddq, Vector7::Zero());
  }
}

TEST_P(Trajectories, velocity_and_acceleration_are_derivatives_of_the_joints) {
  constexpr double h = 1e-5;
  for (int n = 0; n < 50; ++n) {
    MinJerkJoint motion({posture(0.9), 2}, limits);
    motion.start(joints_moving());
    for (double t = 0.013; t < motion.duration() - 0.01; t += 0.0937) {
      Reference before, at, after;
      motion.step(at_home(), t - h, before);
      motion.step(at_home(), t, at);
      motion.step(at_home(), t + h, after);
      EXPECT_LT((at.joint.dq - (after.joint.q - before.joint.q) / (2 * h)).norm(), 1e-5);
      EXPECT_LT((at.joint.ddq - (after.joint.dq - before.joint.dq) / (2 * h)).norm(), 2e-2);
    }
  }
}

TEST_P(Trajectories, velocity_and_acceleration_are_derivatives_of_the_pose) {
  constexpr double h = 1e-5;
  for (int n = 0; n < 50; ++n) {
    MinJerkPose motion({0.5 * direction(), realtime::exp(uniform(0, 3.1) * direction()), 2}, limits);
    motion.start(pose_moving());
    for (double t = 0.013; t < motion.duration() - 0.01; t += 0.0937) {
      Reference before, at, after;
      motion.step(at_home(), t - h, before);
      motion.step(at_home(), t, at);
      motion.step(at_home(), t + h, after);
      const auto& a = before.cartesian;
      const auto& b = after.cartesian;
      Vector6 velocity;
      velocity << (b.position - a.position) / (2 * h),
          realtime::log(b.orientation * a.orientation.conjugate()) / (2 * h);
      EXPECT_LT((at.cartesian.velocity - velocity).norm(), 1e-5);
      EXPECT_LT((at.cartesian.acceleration - (b.velocity - a.velocity) / (2 * h)).norm(), 2e-2);
    }
  }
}

TEST_P(Trajectories, poses_begin_at_the_reference_with_its_velocity_and_acceleration_and_end_at_rest) {
  for (int n = 0; n < 200; ++n) {
    const Reference from = pose_moving();
    const Vector3 position = 0.5 * direction();
    const Eigen::Quaterniond orientation = realtime::exp(uniform(0, 3.1) * direction());
    MinJerkPose motion({position, orientation, uniform(0.001, 3)}, limits);
    motion.start(from);
    Reference at;
    EXPECT_FALSE(motion.step(at_home(), 0, at));
    EXPECT_LT((at.cartesian.position - from.cartesian.position).norm(), 1e-12);
    EXPECT_LT(angle_between(at.cartesian.orientation, from.cartesian.orientation), 1e-9);
    EXPECT_LT((at.cartesian.velocity - from.cartesian.velocity).norm(), 1e-9);
    EXPECT_LT((at.cartesian.acceleration - from.cartesian.acceleration).norm(), 1e-6);
    EXPECT_FALSE(motion.step(at_home(), motion.duration() - 1e-9, at));
    EXPECT_LT(angle_between(at.cartesian.orientation, orientation), 1e-7);
    EXPECT_LT(at.cartesian.velocity.norm(), 1e-4);
    EXPECT_TRUE(motion.step(at_home(), motion.duration(), at));
    EXPECT_EQ(at.cartesian.position, position);
    EXPECT_LT(angle_between(at.cartesian.orientation, orientation), 1e-12);
    EXPECT_EQ(at.cartesian.velocity, Vector6::Zero());
  }
}

TEST_P(Trajectories, orientation_takes_the_shortest_rotation_also_beyond_90_degrees) {
  for (const double angle : {0.3, 1.6, 2.5, 3.1}) {
    const Reference from = pose_at_rest();
    const Vector3 axis = direction();
    Eigen::Quaterniond goal = realtime::exp(angle * axis) * from.cartesian.orientation;
    goal.coeffs() *= -1;  // the same rotation
    MinJerkPose motion({from.cartesian.position, goal, 3}, limits);
    motion.start(from);
    double turned = 0;
    Eigen::Quaterniond last = from.cartesian.orientation;
    Reference at;
    for (int k = 1; k <= 100; ++k) {
      motion.step(at_home(), motion.duration() * k / 100, at);
      const Vector3 turn = realtime::log(at.cartesian.orientation * last.conjugate());
      EXPECT_LT(turn.cross(axis).norm(), 1e-9) << "leaves the axis";
      turned += turn.norm();
      last = at.cartesian.orientation;
    }
    EXPECT_NEAR(turned, angle, 1e-9);
  }
}

TEST_P(Trajectories, a_slow_motion_that_begins_fast_does_not_swing_wide) {
  Reference from = joints_at_rest();
  from.joint.q = posture(0.1);
  from.joint.dq.setConstant(0.8);
  MinJerkJoint motion({from.joint.q, 10}, limits);
  motion.start(from);
  Reference at;
  for (double t = 0; t < motion.duration(); t += 0.01) {
    motion.step(at_home(), t, at);
    ASSERT_LT((at.joint.q - from.joint.q).cwiseAbs().maxCoeff(), 0.2);
  }
}

// Every output of the generator obeys, so that the limiter (which is told by differences, and tested
// against them) has nothing to do.
TEST_P(Trajectories, any_motion_passes_the_limiter_unchanged) {
  for (int n = 0; n < 60; ++n) {
    for (const bool moving : {false, true}) {
      for (const bool joint : {true, false}) {
        const Reference from =
            joint ? (moving ? joints_moving() : joints_at_rest()) : (moving ? pose_moving() : pose_at_rest());
        const double duration = uniform(0.001, 2);
        std::unique_ptr<realtime::TrajectoryGenerator> motion;
        if (joint) {
          motion = std::make_unique<MinJerkJoint>(MinJerkJoint::Parameters{posture(1), duration}, limits);
        } else {
          motion = std::make_unique<MinJerkPose>(
              MinJerkPose::Parameters{0.5 * direction(), realtime::exp(uniform(0, 3.1) * direction()), duration},
              limits);
        }
        motion->start(from);
        realtime::Limiter limiter(limits);
        limiter.reset(from);
        Reference wanted, out;
        int held = 0, k = 0;
        while (!motion->step(at_home(), ++k * kDt, wanted)) held += limiter.follow(wanted, kDt, out);
        EXPECT_EQ(held, 0) << "motion " << n << (moving ? " moving" : " from rest") << (joint ? " joints" : " pose")
                           << ", asked " << duration << " s, takes " << motion->duration() << " s";
      }
    }
  }
}

TEST_P(Trajectories, uneven_ticks_give_the_same_references_at_the_same_times) {
  MinJerkJoint joint({posture(0.9), 1}, limits);
  MinJerkPose pose({0.5 * direction(), realtime::exp(2 * direction()), 1}, limits);
  const Reference from_joint = joints_moving(), from_pose = pose_moving();
  for (realtime::TrajectoryGenerator* motion :
       {static_cast<realtime::TrajectoryGenerator*>(&joint), static_cast<realtime::TrajectoryGenerator*>(&pose)}) {
    const Reference& from = motion == &joint ? from_joint : from_pose;
    std::vector<Reference> even;
    motion->start(from);
    for (int ms = 0; ms < 4000; ++ms) {
      Reference at;
      motion->step(at_home(), ms * kDt, at);
      even.push_back(at);
    }
    motion->start(from);
    const int ticks[] = {1, 2, 1, 3, 5};
    for (int ms = 0, n = 0; ms < 4000; ms += ticks[n++ % 5]) {
      Reference at;
      motion->step(at_home(), ms * kDt, at);
      EXPECT_EQ(at.joint.q, even[ms].joint.q);
      EXPECT_EQ(at.cartesian.position, even[ms].cartesian.position);
      EXPECT_EQ(at.cartesian.velocity, even[ms].cartesian.velocity);
    }
  }
}

TEST_P(Trajectories, relative_joints_go_from_the_reference_at_the_start) {
  const Reference from = joints_moving();
  Vector7 delta;
  delta << 0.1, -0.2, 0.05, 0.1, -0.1, 0.2, 0.3;
  RelativeMinJerkJoint motion({delta, 2}, limits);
  motion.start(from);
  EXPECT_EQ(motion.goal().joint.q, from.joint.q + delta);
  Reference at;
  EXPECT_TRUE(motion.step(at_home(), motion.duration(), at));
  EXPECT_EQ(at.joint.q, from.joint.q + delta);

  RelativeMinJerkJoint far({Vector7::Constant(2), 2}, limits);
  far.start(from);
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(far.goal().joint.q[i], std::min(from.joint.q[i] + 2, realtime::rest_max(limits, i)));
  }
}

TEST_P(Trajectories, relative_poses_go_from_the_reference_at_the_start_in_either_frame) {
  using Frame = realtime::PoseDifference::Frame;
  const Reference from = pose_moving();
  const Vector3 by(0.1, 0.02, -0.05);
  const Eigen::Quaterniond turn = realtime::exp(Vector3(0.1, 2, 0.3));
  Eigen::Isometry3d start(from.cartesian.orientation), difference(turn);
  start.translation() = from.cartesian.position;
  difference.translation() = by;

  RelativeMinJerkPose in_EE({by, turn, Frame::kEndEffector}, 2, limits);
  in_EE.start(from);
  const Eigen::Isometry3d goal = start * difference;
  EXPECT_TRUE(in_EE.goal().cartesian.position.isApprox(goal.translation(), 1e-12));
  EXPECT_TRUE(in_EE.goal().cartesian.orientation.toRotationMatrix().isApprox(goal.linear(), 1e-12));

  RelativeMinJerkPose in_O({by, turn, Frame::kBase}, 2, limits);
  in_O.start(from);
  EXPECT_TRUE(in_O.goal().cartesian.position.isApprox(from.cartesian.position + by, 1e-12));
  EXPECT_TRUE(in_O.goal().cartesian.orientation.toRotationMatrix().isApprox(goal.linear(), 1e-12));
}

bool says(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

TEST_P(Trajectories, each_bad_field_is_refused_by_name_value_and_bound) {
  const Vector7 q = posture(0.5);
  const Eigen::Quaterniond I = Eigen::Quaterniond::Identity();
  const double nan = std::nan("");
  for (int i = 0; i < 7; ++i) {
    const std::string name = "q[" + std::to_string(i) + "]";
    for (const double bad : {limits.q_max[i] + 0.01, limits.q_min[i] - 0.01, nan, double{INFINITY}}) {
      Vector7 wrong = q;
      wrong[i] = bad;
      const std::string text = refusal([&] { MinJerkJoint({wrong, 1}, limits); });
      EXPECT_TRUE(says(text, name)) << text;
      EXPECT_TRUE(says(text, "rad")) << text;
    }
  }
  Vector7 delta = Vector7::Zero();
  delta[2] = nan;
  EXPECT_TRUE(says(refusal([&] { RelativeMinJerkJoint({delta, 1}, limits); }), "delta_q[2] is nan"));
  for (const double bad : {0.0, -1.0, nan, 1e9}) {
    for (const auto& text :
         {refusal([&] {
            MinJerkJoint({q, bad}, limits);
          }),
          refusal([&] {
            RelativeMinJerkJoint({Vector7::Zero(), bad}, limits);
          }),
          refusal([&] {
            MinJerkPose({Vector3::Zero(), I, bad}, limits);
          }),
          refusal([&] {
            RelativeMinJerkPose({Vector3::Zero(), I, realtime::PoseDifference::Frame::kBase}, bad, limits);
          })}) {
      EXPECT_TRUE(says(text, "duration is ")) << text;
    }
  }
  EXPECT_TRUE(says(refusal([&] { MinJerkPose({Vector3(0, nan, 0), I, 1}, limits); }), "position[1] is nan"));
  EXPECT_TRUE(says(refusal([&] { MinJerkPose({Vector3(0, 0, 3), I, 1}, limits); }), "position[2] is 3"));
  const Eigen::Quaterniond half(0.5, 0, 0, 0), none(nan, 0, 0, 0);
  for (const auto& bad : {half, none}) {
    EXPECT_TRUE(says(refusal([&] { MinJerkPose({Vector3::Zero(), bad, 1}, limits); }), "quaternion"));
    EXPECT_TRUE(says(refusal([&] {
                       RelativeMinJerkPose({Vector3::Zero(), bad, realtime::PoseDifference::Frame::kBase}, 1, limits);
                     }),
                     "quaternion"));
  }
  EXPECT_TRUE(says(refusal([&] {
                     RelativeMinJerkPose({Vector3(nan, 0, 0), I, realtime::PoseDifference::Frame::kBase}, 1, limits);
                   }),
                   "translation[0] is nan"));
}

TEST_P(Trajectories, start_and_step_allocate_nothing) {
  if (!allocations::kCounts) GTEST_SKIP() << "the heap belongs to a sanitizer";
  MinJerkJoint joint({posture(0.9), 0.5}, limits);
  RelativeMinJerkJoint relative_joint({Vector7::Constant(0.1), 0.5}, limits);
  MinJerkPose pose({0.5 * direction(), realtime::exp(2 * direction()), 0.5}, limits);
  RelativeMinJerkPose relative_pose(
      {Vector3::Constant(0.1), realtime::exp(direction()), realtime::PoseDifference::Frame::kBase}, 0.5, limits);
  const Reference from_joint = joints_moving(), from_pose = pose_moving();
  Reference at;
  const realtime::Cycle& cycle = at_home();
  const testing_tools::AllocationCounter allocations;
  for (realtime::TrajectoryGenerator* motion : {static_cast<realtime::TrajectoryGenerator*>(&joint),
                                                static_cast<realtime::TrajectoryGenerator*>(&relative_joint),
                                                static_cast<realtime::TrajectoryGenerator*>(&pose),
                                                static_cast<realtime::TrajectoryGenerator*>(&relative_pose)}) {
    motion->start(motion_of(motion->fills()) == Channels::kJoint ? from_joint : from_pose);
    for (int k = 0; k < 1000; ++k) motion->step(cycle, k * kDt, at);
  }
  EXPECT_EQ(allocations.count(), 0);
}

}  // namespace
