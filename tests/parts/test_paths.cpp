// Waypoints and samples: passed where and when they should be.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>
#include <string>

#include "models/arm.hpp"
#include "realtime/rotation.hpp"
#include "realtime/trajectories/impulse.hpp"
#include "realtime/trajectories/joint_samples.hpp"
#include "realtime/trajectories/joint_waypoints.hpp"
#include "realtime/trajectories/linear_force_position.hpp"
#include "realtime/trajectories/pose_samples.hpp"
#include "realtime/trajectories/pose_waypoints.hpp"
#include "realtime/trajectories/time_optimal_joint.hpp"
#include "tests/parts/refusal.hpp"
#include "tests/realtime/at_home.hpp"
#include "tests/realtime/home.hpp"

namespace {

using realtime::JointSamples;
using realtime::JointWaypoints;
using realtime::PoseSamples;
using realtime::PoseWaypoints;
using realtime::Reference;
using realtime::Channels;
using realtime::Vector3;
using realtime::Vector6;
using realtime::Vector7;

class Paths : public testing::TestWithParam<const char*> {
 protected:
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  std::mt19937 random{5};
  double uniform(double low, double high) { return std::uniform_real_distribution<>(low, high)(random); }
  Vector7 posture(double most) {
    Vector7 q = home();
    for (double& each : q) each += uniform(-most, most);
    return q;
  }
  static Reference joints() {
    Reference from;
    from.joint.q = home();
    return from;
  }
  static Reference pose(const Eigen::Isometry3d& T) {
    Reference from;
    from.motion = Channels::kPose;
    from.cartesian.position = T.translation();
    from.cartesian.orientation = Eigen::Quaterniond(T.linear());
    return from;
  }
  Eigen::Isometry3d place(double most) {
    Eigen::Isometry3d T(realtime::exp(Vector3(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1))) *
                        Eigen::Quaterniond(0, 1, 0, 0));
    T.translation() = Vector3(0.45, 0, 0.4) + most * Vector3(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
    return T;
  }
};

INSTANTIATE_TEST_SUITE_P(Arms, Paths, testing::Values("fer", "fr3"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(Paths, joint_waypoints_are_passed_at_their_times) {
  JointWaypoints::Parameters parameters{{}, {1.5, 2.25, 3.75, 5}, 0.5};
  for (int k = 0; k < 4; ++k) parameters.q.push_back(posture(0.15));
  JointWaypoints motion(parameters, limits, home());
  Reference from = joints(), at;
  for (const bool moving : {false, true}) {
    if (moving) {
      from.joint.q.array() += 0.02;
      from.joint.dq.setConstant(0.1);
    }
    motion.start(from);
    EXPECT_EQ(motion.stretch(), 1);
    EXPECT_NEAR(motion.duration(), 5, 1e-12);
    for (std::size_t k = 0; k < 4; ++k) {
      motion.step(at_home(), parameters.times[k], at);
      EXPECT_LT((at.joint.q - parameters.q[k]).norm(), 1e-12) << k;
    }
  }
}

// Where what fades takes longer than the first waypoint allows, all of them wait.
TEST_P(Paths, waypoints_are_passed_also_from_elsewhere) {
  JointWaypoints::Parameters parameters{{posture(0.02), posture(0.1)}, {0.2, 2}, 0.5};
  JointWaypoints motion(parameters, limits, home());
  Reference from = joints(), at;
  from.joint.q[0] += 0.5;
  motion.start(from);
  const double wait = motion.duration() - motion.stretch() * 2;
  EXPECT_GT(wait, 0.1);
  motion.step(at_home(), wait + motion.stretch() * 0.2, at);
  EXPECT_LT((at.joint.q - parameters.q[0]).norm(), 1e-12);
}

TEST_P(Paths, waypoints_that_come_too_soon_are_stretched_to_the_limits) {
  JointWaypoints::Parameters parameters{{}, {}, 0.5};
  for (int k = 0; k < 4; ++k) {
    parameters.q.push_back(posture(0.3));
    parameters.times.push_back(0.05 * (k + 1));
  }
  JointWaypoints motion(parameters, limits, home());
  motion.start(joints());
  EXPECT_GT(motion.stretch(), 2);
  EXPECT_NEAR(motion.duration(), 0.2 * motion.stretch(), 1e-9);
  double used = 0;
  Reference at, before = joints();
  for (double t = 0; t < motion.duration(); t += 1e-3) {
    motion.step(at_home(), t, at);
    for (int i = 0; i < 7; ++i) {
      const double most = at.joint.dq[i] > 0 ? limits.dq_upper(i, at.joint.q[i]) : -limits.dq_lower(i, at.joint.q[i]);
      used = std::max({used, std::abs(at.joint.dq[i]) / most, std::abs(at.joint.ddq[i]) / limits.ddq_max[i],
                       std::abs(at.joint.ddq[i] - before.joint.ddq[i]) / 1e-3 / limits.dddq_max[i]});
    }
    before = at;
  }
  EXPECT_LE(used, 1);
  EXPECT_GT(used, 0.85);
}

TEST_P(Paths, without_times_waypoints_are_passed_in_nearly_the_least_time) {
  for (const double speed : {0.1, 0.5, 1.0}) {
    // To a single one there is no shorter motion than the one of time-optimal jerk.
    const Vector7 goal = posture(0.4);
    JointWaypoints one({{goal}, {}, speed}, limits, home());
    realtime::TimeOptimalJoint least({goal, speed}, limits);
    one.start(joints());
    least.start(joints());
    EXPECT_EQ(one.stretch(), 1);
    EXPECT_GT(one.duration(), 0.99 * least.duration());
    EXPECT_LT(one.duration(), 1.6 * least.duration());
    // Many on a line need not stop at each.
    JointWaypoints::Parameters line{{}, {}, speed};
    for (int k = 1; k <= 10; ++k) line.q.push_back(home() + 0.1 * k * (goal - home()));
    JointWaypoints many(line, limits, home());
    many.start(joints());
    EXPECT_LT(many.duration(), 1.4 * one.duration());
    EXPECT_GT(many.duration(), 0.99 * least.duration());
  }
}

TEST_P(Paths, waypoints_of_poses_are_passed_at_their_times) {
  const Eigen::Isometry3d start = place(0.05);
  PoseWaypoints::Parameters parameters{{}, {}, {4, 6, 10}, 0.5};
  for (int k = 0; k < 3; ++k) {
    const Eigen::Isometry3d T = place(0.1);
    parameters.position.push_back(T.translation());
    parameters.orientation.emplace_back(T.linear());
    if (k == 1) parameters.orientation.back().coeffs() *= -1;  // the same rotation
  }
  PoseWaypoints motion(parameters, limits, start);
  motion.start(pose(start));
  ASSERT_EQ(motion.stretch(), 1);
  Reference at;
  for (std::size_t k = 0; k < 3; ++k) {
    motion.step(at_home(), parameters.times[k], at);
    EXPECT_LT((at.cartesian.position - parameters.position[k]).norm(), 1e-12);
    EXPECT_LT(at.cartesian.orientation.angularDistance(parameters.orientation[k]), 1e-7);
  }
  EXPECT_LT(motion.goal().cartesian.velocity.norm(), 1e-12);
}

TEST_P(Paths, a_turn_between_two_poses_is_the_shortest) {
  const Eigen::Isometry3d start = place(0);
  const Vector3 axis = Vector3(2, -1, 2) / 3;
  PoseWaypoints motion(
      {{start.translation()}, {realtime::exp(2.0 * axis) * Eigen::Quaterniond(start.linear())}, {}, 0.5}, limits,
      start);
  motion.start(pose(start));
  Reference at;
  for (double t = 0; t < motion.duration(); t += 0.05) {
    motion.step(at_home(), t, at);
    const Vector3 r = realtime::log(at.cartesian.orientation * Eigen::Quaterniond(start.linear()).conjugate());
    EXPECT_LT(r.cross(axis).norm(), 1e-9);
  }
}

TEST_P(Paths, samples_are_followed_exactly_each_ms) {
  const auto rise = [](double s) { return s * s * s * (10 + s * (-15 + 6 * s)); };
  realtime::Samples<7>::Table q(7, 2001);
  for (int k = 0; k <= 2000; ++k) q.col(k) = home().array() + 0.2 * rise(k / 2000.0);
  JointSamples motion(q, limits, home());
  motion.start(joints());
  EXPECT_EQ(motion.stretch(), 1);
  EXPECT_NEAR(motion.duration(), 2, 1e-12);
  Reference at;
  for (int k = 0; k < 2000; ++k) {
    motion.step(at_home(), k * 1e-3, at);
    EXPECT_LT((at.joint.q - q.col(k)).norm(), 1e-9);
    // Velocity of the curve that was sampled.
    const double s = k / 2000.0;
    EXPECT_NEAR(at.joint.dq[0], 0.2 / 2 * 30 * s * s * (1 - s) * (1 - s), 1e-5);
  }
  motion.step(at_home(), 0.5005, at);
  EXPECT_NEAR(at.joint.q[3], home()[3] + 0.2 * rise(0.5005 / 2), 1e-9);
}

TEST_P(Paths, samples_that_are_too_fast_are_stretched_and_noise_is_not) {
  std::normal_distribution<> noise(0, 4e-5);
  realtime::Samples<7>::Table q(7, 1001);
  for (const double way : {0.1, 2.0}) {
    for (int k = 0; k <= 1000; ++k) {
      const double s = k / 1000.0;
      for (int i = 0; i < 7; ++i)
        q(i, k) = home()[i] + (i == 0 ? way * s * s * s * (10 + s * (6 * s - 15)) : 0) + noise(random);
    }
    JointSamples motion(q, limits, home());
    if (way < 1) {
      EXPECT_EQ(motion.stretch(), 1);
    } else {
      EXPECT_GT(motion.stretch(), 1.4);  // 3.75 rad/s and 11.5 rad/s² are asked for
      EXPECT_LT(motion.stretch(), 2.2);
    }
  }
}

TEST_P(Paths, samples_of_poses_are_followed_exactly_each_ms) {
  const Eigen::Isometry3d start = place(0);
  PoseSamples::Positions position(3, 1501);
  PoseSamples::Quaternions quaternion(4, 1501);
  for (int k = 0; k <= 1500; ++k) {
    const double s = std::pow(std::sin(k * M_PI / 1500), 2);
    position.col(k) = start.translation() + s * Vector3(0.02, 0.05, -0.03);
    const Eigen::Quaterniond o = realtime::exp(s * Vector3(0.2, 0.3, -0.1)) * Eigen::Quaterniond(start.linear());
    quaternion.col(k) << o.w(), o.vec();
    if (k % 3 == 0) quaternion.col(k) *= -1;  // the same rotation
  }
  PoseSamples motion(position, quaternion, limits, start);
  motion.start(pose(start));
  ASSERT_EQ(motion.stretch(), 1);
  Reference at;
  for (int k = 14; k < 1500; k += 7) {  // how they begin to move has faded away
    motion.step(at_home(), k * 1e-3, at);
    EXPECT_LT((at.cartesian.position - position.col(k)).norm(), 1e-12);
    const auto& o = quaternion.col(k);
    EXPECT_LT(at.cartesian.orientation.angularDistance(Eigen::Quaterniond(o[0], o[1], o[2], o[3])), 1e-7);
  }
}

// From a little beside the first sample, and moving, it comes onto them.
TEST_P(Paths, what_differs_at_the_start_fades_away) {
  realtime::Samples<7>::Table q(7, 2001);
  for (int k = 0; k <= 2000; ++k) q.col(k) = home().array() + 0.2 * std::pow(std::sin(k * M_PI / 2000), 2);
  JointSamples motion(q, limits, home());
  Reference from = joints(), at;
  from.joint.q.array() -= 0.03;
  from.joint.dq.setConstant(0.1);
  motion.start(from);
  motion.step(at_home(), 0, at);
  EXPECT_LT((at.joint.q - from.joint.q).norm(), 1e-12);
  motion.step(at_home(), 1, at);
  EXPECT_LT((at.joint.q - q.col(1000)).norm(), 1e-12);
}

// An arm that sags by little is not jerked back.
TEST_P(Paths, what_differs_by_little_fades_away_gently) {
  const Eigen::Isometry3d start = place(0);
  const Eigen::Quaterniond o(start.linear());
  const PoseSamples::Positions position = start.translation().replicate(1, 2001);
  const PoseSamples::Quaternions quaternion = Eigen::Vector4d(o.w(), o.x(), o.y(), o.z()).replicate(1, 2001);
  PoseSamples motion(position, quaternion, limits, start);
  Reference from = pose(start), at;
  from.cartesian.position.z() += 1e-4;
  motion.start(from);
  double most = 0;
  for (int k = 0; k < 200; ++k) {
    motion.step(at_home(), k * 1e-3, at);
    most = std::max(most, at.cartesian.acceleration.norm());
  }
  EXPECT_LT(most, 0.051 * limits.translation.acceleration);
  EXPECT_LT((at.cartesian.position - start.translation()).norm(), 1e-12);
}

TEST_P(Paths, refuse_what_does_not_fit_by_name) {
  const auto waypoints = [&](std::vector<Vector7> q, std::vector<double> times, double speed = 0.5) {
    return refusal([&] { JointWaypoints({q, times, speed}, limits, home()); });
  };
  EXPECT_EQ(waypoints({posture(0.1), posture(0.1)}, {1, 2}), "accepted");
  EXPECT_EQ(waypoints({}, {}), "q is empty: expected at least one waypoint");
  EXPECT_TRUE(waypoints({home()}, {1, 2}).starts_with("times has 2 elements: expected 1, one for each waypoint"));
  EXPECT_TRUE(waypoints({home(), home()}, {2, 1}).starts_with("times[1] is 1, and should lie within 2.001"));
  EXPECT_TRUE(waypoints({home()}, {}, 2).starts_with("speed is 2"));
  Vector7 far = home();
  far[3] = 0.5;
  EXPECT_TRUE(waypoints({home(), far}, {}).starts_with("waypoint 1 of q[3] is 0.5"));
  // Both within the range, with a bow between them that is not.
  Vector7 near = home();
  near[3] = limits.q_max[3] - 0.4;
  Vector7 end = home();
  end[3] = limits.q_max[3] - 0.2;
  const std::string bow = waypoints({near, end, end}, {2, 2.3, 20});
  EXPECT_NE(bow.find("joint 4 would be at"), std::string::npos) << bow;

  realtime::Samples<7>::Table q = home().replicate(1, 10);
  q(2, 0) += 0.3;
  const std::string away = refusal([&] { JointSamples(q, limits, home()); });
  EXPECT_TRUE(away.starts_with("the first sample has joint 3 at 0.3 rad, and the arm has it at 0: move it")) << away;
  q(2, 0) = 0;
  q(3, 4) = 0.5;
  EXPECT_TRUE(refusal([&] { JointSamples(q, limits, home()); }).starts_with("sample 4 of q[3] is 0.5"));
  EXPECT_TRUE(refusal([&] { JointSamples(home(), limits, home()); }).starts_with("number of samples is 1,"));

  const Eigen::Isometry3d start = place(0);
  PoseSamples::Positions p = start.translation().replicate(1, 5);
  PoseSamples::Quaternions o(4, 5);
  o.colwise() = Eigen::Vector4d(0, 1, 0, 0);
  const std::string turned = refusal([&] { PoseSamples(p, o.leftCols(4), limits, start); });
  EXPECT_EQ(turned, "there are 5 positions and 4 quaternions: expected one of each for every pose");
  p.row(0).array() += 0.1;
  EXPECT_TRUE(refusal([&] { PoseSamples(p, o, limits, start); }).starts_with("the first sample is 0.1 m and "));
}

// --- beside a motion -------------------------------------------------------------------------------------------------

TEST(Impulses, rise_hold_and_fall) {
  realtime::Impulse impulse({Vector3(0, 0, 10), Vector3(1, 0, 0), 0.2, 1});
  EXPECT_EQ(impulse.fills(), realtime::Channels::kPose | realtime::Channels::kWrench);
  Reference from, at;
  from.motion = Channels::kPose;
  from.cartesian.velocity.setOnes();
  impulse.start(from);
  for (const auto& [time, share] :
       {std::pair{0.0, 0.0}, {0.1, 0.5}, {0.2, 1.0}, {0.5, 1.0}, {0.8, 1.0}, {0.95, 0.25}}) {
    EXPECT_FALSE(impulse.step(at_home(), time, at));
    EXPECT_LT((at.wrench - share * (Vector6() << 0, 0, 10, 1, 0, 0).finished()).norm(), 1e-12) << time;
    EXPECT_EQ(at.cartesian.velocity.norm(), 0);
  }
  EXPECT_TRUE(impulse.step(at_home(), 1, at));
  EXPECT_EQ(at.wrench.norm(), 0);
  from.wrench << 0, 4, 0, 0, 0, 0;
  impulse.start(from);
  for (const auto& [time, y, z] : {std::tuple{0.0, 4., 0.}, {0.05, 3., 2.5}, {0.2, 0., 10.}, {0.9, 0., 5.}}) {
    EXPECT_FALSE(impulse.step(at_home(), time, at));
    EXPECT_NEAR(at.wrench[1], y, 1e-12) << "what another exerted before goes as this one comes";
    EXPECT_NEAR(at.wrench[2], z, 1e-12);
  }
  EXPECT_TRUE(impulse.step(at_home(), 1, at));
  EXPECT_EQ(at.wrench.norm(), 0);
  EXPECT_TRUE(refusal([] {
                realtime::Impulse({Vector3(300, 0, 0), Vector3::Zero(), 0.1, 1});
              }).starts_with("force[0] is 300"));
  EXPECT_TRUE(refusal([] {
                realtime::Impulse({Vector3::Zero(), Vector3::Zero(), 0.6, 1});
              }).starts_with("acc_duration is 0.6"));
}

TEST(LinearForcePositions, lead_pose_and_wrench_in_proportion) {
  const models::Limits& limits = models::limits(models::arm("fer"), 5);
  realtime::LinearForcePosition motion({{{0.5, 0, 0.4}, {0, 1, 0, 0}, 4}, Vector3(0, 0, -8), Vector3(0, 1, 0)}, limits);
  EXPECT_EQ(motion.fills(), realtime::Channels::kPose | realtime::Channels::kWrench);
  Reference from, at;
  from.motion = Channels::kPose;
  from.cartesian.position = {0.4, 0.1, 0.4};
  from.cartesian.orientation = Eigen::Quaterniond(0, 1, 0, 0);
  from.wrench << 4, 0, 0, 0, 0, 0;
  motion.start(from);
  EXPECT_FALSE(motion.step(at_home(), 1, at));
  EXPECT_LT((at.cartesian.position - Vector3(0.425, 0.075, 0.4)).norm(), 1e-12);
  EXPECT_LT((at.wrench - (Vector6() << 3, 0, -2, 0, 0.25, 0).finished()).norm(), 1e-12);
  EXPECT_TRUE(motion.step(at_home(), 4, at));
  EXPECT_LT((at.wrench - (Vector6() << 0, 0, -8, 0, 1, 0).finished()).norm(), 1e-12);
}

}  // namespace
