// Laws that every trajectory keeps, of those that are not of least jerk (test_trajectories.cpp).

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "models/arm.hpp"
#include "realtime/limiter.hpp"
#include "realtime/rotation.hpp"
#include "realtime/trajectories/constant_velocity.hpp"
#include "realtime/trajectories/impulse.hpp"
#include "realtime/trajectories/joint_dmp.hpp"
#include "realtime/trajectories/joint_samples.hpp"
#include "realtime/trajectories/joint_waypoints.hpp"
#include "realtime/trajectories/linear_force_position.hpp"
#include "realtime/trajectories/pose_dmp.hpp"
#include "realtime/trajectories/pose_samples.hpp"
#include "realtime/trajectories/pose_waypoints.hpp"
#include "realtime/trajectories/quaternion_pose_dmp.hpp"
#include "realtime/trajectories/relative_linear_pose.hpp"
#include "realtime/trajectories/stay.hpp"
#include "realtime/trajectories/time_optimal_joint.hpp"
#include "realtime/trajectories/time_optimal_pose.hpp"
#include "realtime/trajectories/timed_joint.hpp"
#include "realtime/trajectories/timed_pose.hpp"
#include "tests/realtime/allocation_counter.hpp"
#include "tests/realtime/at_home.hpp"
#include "tests/realtime/dt.hpp"
#include "tests/realtime/home.hpp"

namespace {

using realtime::Reference;
using realtime::Channels;
using realtime::TimeLaw;
using realtime::Vector3;
using realtime::Vector6;
using realtime::Vector7;
using Generator = std::unique_ptr<realtime::TrajectoryGenerator>;


struct Case {
  std::string name;
  std::function<Generator(const models::Limits&, std::mt19937&)> make;
  bool smooth = true;  // velocity without steps: the limiter holds nothing back from rest
};

double uniform(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution<>(low, high)(random);
}
Vector3 direction(std::mt19937& random) {
  std::normal_distribution<> normal;
  return Vector3(normal(random), normal(random), normal(random)).normalized();
}
Vector7 posture(std::mt19937& random) {
  Vector7 q = home();
  for (double& each : q) each += uniform(random, -0.4, 0.4);
  return q;
}
Vector3 position(std::mt19937& random) { return Vector3(0.4, 0, 0.4) + 0.2 * direction(random); }
Eigen::Quaterniond orientation(std::mt19937& random) {
  return realtime::exp(uniform(random, 0, 2) * direction(random)) * Eigen::Quaterniond(0, 1, 0, 0);
}

// Weights of some basis functions that lie along the phase of `duration` s.
realtime::DmpForce force(std::mt19937& random, int dimensions, double most) {
  realtime::DmpForce force;
  for (int k = 0; k < 6; ++k) {
    force.mu.push_back(std::exp(-0.1 * k));
    force.h.push_back(100);
  }
  for (int i = 0; i < 6 * dimensions; ++i) force.weights.push_back(uniform(random, -most, most));
  return force;
}
realtime::DmpSpring spring(double duration) { return {0.5 / duration, 25, 6}; }

std::vector<double> times(std::mt19937& random, std::size_t count) {
  std::vector<double> times;
  for (std::size_t k = 0; k < count; ++k) times.push_back((k == 0 ? 0 : times.back()) + uniform(random, 0.1, 0.2));
  return times;
}
template <bool timed>
Generator joint_waypoints(const models::Limits& limits, std::mt19937& random) {
  realtime::JointWaypoints::Parameters parameters{{}, {}, uniform(random, 0.1, 1)};
  for (int k = 0; k < 5; ++k) parameters.q.push_back(home() + 0.4 * (posture(random) - home()));
  if (timed) parameters.times = times(random, 5);
  return std::make_unique<realtime::JointWaypoints>(parameters, limits, home());
}
template <bool timed>
Generator pose_waypoints(const models::Limits& limits, std::mt19937& random) {
  realtime::PoseWaypoints::Parameters parameters{{}, {}, {}, uniform(random, 0.1, 1)};
  for (int k = 0; k < 5; ++k) {
    parameters.position.push_back(position(random));
    parameters.orientation.push_back(orientation(random));
  }
  if (timed) parameters.times = times(random, 5);
  Eigen::Isometry3d from(orientation(random));
  from.translation() = position(random);
  return std::make_unique<realtime::PoseWaypoints>(parameters, limits, from);
}

Case joint(const std::string& name, TimeLaw law, bool smooth) {
  return {name,
          [law](const models::Limits& limits, std::mt19937& random) -> Generator {
            return std::make_unique<realtime::TimedJoint>(
                law, realtime::TimedJoint::Parameters{posture(random), uniform(random, 0.01, 3)}, limits);
          },
          smooth};
}
Case pose(const std::string& name, TimeLaw law, bool smooth) {
  return {name,
          [law](const models::Limits& limits, std::mt19937& random) -> Generator {
            return std::make_unique<realtime::TimedPose>(
                law, realtime::TimedPose::Parameters{position(random), orientation(random), uniform(random, 0.01, 3)},
                limits);
          },
          smooth};
}

const std::vector<Case> kCases = {
    joint("LinearJoint", TimeLaw::kLinear, false),
    joint("SineJoint", TimeLaw::kSine, false),  // its acceleration begins at once
    joint("CubicHermiteJoint", TimeLaw::kCubicHermite, false),
    pose("LinearPose", TimeLaw::kLinear, false),
    pose("SinePose", TimeLaw::kSine, false),
    pose("CubicHermitePose", TimeLaw::kCubicHermite, false),
    {"RelativeLinearPose",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       return std::make_unique<realtime::RelativeLinearPose>(
           realtime::PoseDifference(0.2 * direction(random), realtime::exp(direction(random)),
                                    realtime::PoseDifference::Frame::kEndEffector),
           uniform(random, 0.1, 3), limits);
     },
     false},
    {"JointVelocity",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       Vector7 dq;
       for (double& each : dq) each = uniform(random, -0.3, 0.3);
       return std::make_unique<realtime::JointVelocity>(
           realtime::JointVelocity::Parameters{dq, Vector7(Vector7::Constant(2)), uniform(random, 0.1, 1.5)}, limits);
     }},
    {"CartesianVelocity",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       Vector6 twist;
       twist << 0.2 * direction(random), 0.5 * direction(random);
       return std::make_unique<realtime::CartesianVelocity>(
           realtime::CartesianVelocity::Parameters{twist, {}, uniform(random, 0.1, 2)}, limits, Vector7::Zero());
     }},
    {"TimeOptimalJoint",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       return std::make_unique<realtime::TimeOptimalJoint>(
           realtime::TimeOptimalJoint::Parameters{posture(random), uniform(random, 0.05, 1)}, limits);
     }},
    {"TimeOptimalPose",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       return std::make_unique<realtime::TimeOptimalPose>(
           realtime::TimeOptimalPose::Parameters{position(random), orientation(random), uniform(random, 0.05, 1)}, limits);
     }},
    {"JointDmp",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       const double T = uniform(random, 0.1, 3);
       return std::make_unique<realtime::JointDmp>(
           realtime::JointDmp::Parameters{spring(T), force(random, 7, 0.3), T}, limits);
     },
     false},
    {"PoseDmp",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       const double T = uniform(random, 0.1, 3);
       return std::make_unique<realtime::PoseDmp>(
           realtime::FirstBasis::kMinJerk,
           realtime::PoseDmp::Parameters{spring(T), force(random, 6, 0.3), T, realtime::PoseDmp::Dimensions::kAll, true},
           limits);
     },
     false},
    {"GoalPoseDmp",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       const double T = uniform(random, 0.1, 3);
       return std::make_unique<realtime::PoseDmp>(
           realtime::FirstBasis::kGoal,
           realtime::PoseDmp::Parameters{spring(T), force(random, 3, 0.3), T, realtime::PoseDmp::Dimensions::kPosition},
           limits);
     },
     false},
    {"QuaternionPoseDmp",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       const double T = uniform(random, 0.1, 3);
       return std::make_unique<realtime::QuaternionPoseDmp>(
           realtime::QuaternionPoseDmp::Parameters{spring(T), force(random, 3, 0.3), 25, 6, force(random, 3, 30),
                                                   orientation(random), 0.8 * T, T, false},
           limits);
     },
     false},
    {"Impulse",
     [](const models::Limits&, std::mt19937& random) -> Generator {
       return std::make_unique<realtime::Impulse>(
           realtime::Impulse::Parameters{10 * direction(random), direction(random), 0.1, uniform(random, 0.3, 1)});
     }},
    {"LinearForcePosition",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       return std::make_unique<realtime::LinearForcePosition>(
           realtime::LinearForcePosition::Parameters{{position(random), orientation(random), uniform(random, 0.01, 3)},
                                                     10 * direction(random), direction(random)},
           limits);
     },
     false},
    {"JointWaypoints", joint_waypoints<false>, false},
    {"TimedJointWaypoints", joint_waypoints<true>, false},
    {"PoseWaypoints", pose_waypoints<false>, false},
    {"TimedPoseWaypoints", pose_waypoints<true>, false},
    {"JointSamples",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       realtime::Samples<7>::Table q(7, 800);
       const Vector7 way = posture(random) - home();
       for (int k = 0; k < 800; ++k) q.col(k) = home() + std::pow(std::sin(k * 3.1416 / 1000), 2) * way;
       return std::make_unique<realtime::JointSamples>(q, limits, home());
     },
     false},
    {"RestingJointSamples",
     [](const models::Limits& limits, std::mt19937&) -> Generator {
       return std::make_unique<realtime::JointSamples>(home().replicate(1, 300), limits, home());
     },
     false},
    {"RestingPoseSamples",
     [](const models::Limits& limits, std::mt19937&) -> Generator {
       Eigen::Isometry3d from = Eigen::Isometry3d::Identity();
       from.translation() = Vector3(0.4, 0, 0.4);
       return std::make_unique<realtime::PoseSamples>(from.translation().replicate(1, 300),
                                                      Eigen::Vector4d(1, 0, 0, 0).replicate(1, 300), limits, from);
     },
     false},
    {"PoseSamples",
     [](const models::Limits& limits, std::mt19937& random) -> Generator {
       realtime::PoseSamples::Positions position(3, 800);
       realtime::PoseSamples::Quaternions quaternion(4, 800);
       const Vector3 way = 0.1 * direction(random), turn = direction(random);
       for (int k = 0; k < 800; ++k) {
         const double s = std::pow(std::sin(k * 3.1416 / 1000), 2);
         position.col(k) = Vector3(0.4, 0, 0.4) + s * way;
         const Eigen::Quaterniond q = realtime::exp(s * turn);
         quaternion.col(k) << q.w(), q.vec();
       }
       Eigen::Isometry3d from = Eigen::Isometry3d::Identity();
       from.translation() = position.col(0);
       return std::make_unique<realtime::PoseSamples>(position, quaternion, limits, from);
     },
     false},
    {"StayJoint",
     [](const models::Limits&, std::mt19937& random) -> Generator {
       return std::make_unique<realtime::Stay>(Channels::kJoint, uniform(random, 0.1, 1));
     }},
    {"StayPose",
     [](const models::Limits&, std::mt19937& random) -> Generator {
       return std::make_unique<realtime::Stay>(Channels::kPose, uniform(random, 0.1, 1));
     }},
};

struct Parameter {
  const char* arm;
  std::size_t index;
};

class EveryTrajectory : public testing::TestWithParam<Parameter> {
 protected:
  const Case& test = kCases[GetParam().index];
  const models::Limits& limits = models::limits(models::arm(GetParam().arm), 10);
  std::mt19937 random{7};

  Generator make() { return test.make(limits, random); }
  static Reference at_rest(Channels kind, std::mt19937& random) {
    Reference from;
    from.motion = kind;
    from.joint.q = posture(random);
    from.cartesian.position = position(random);
    from.cartesian.orientation = orientation(random);
    return from;
  }
};

std::vector<Parameter> parameters() {
  std::vector<Parameter> all;
  for (const char* arm : {"fer", "fr3"}) {
    for (std::size_t i = 0; i < kCases.size(); ++i) all.push_back({arm, i});
  }
  return all;
}
INSTANTIATE_TEST_SUITE_P(Arms, EveryTrajectory, testing::ValuesIn(parameters()), [](const auto& info) {
  return kCases[info.param.index].name + "_" + info.param.arm;
});

double distance(const Reference& a, const Reference& b) {
  if (a.motion == Channels::kJoint) return (a.joint.q - b.joint.q).norm();
  return (a.cartesian.position - b.cartesian.position).norm() +
         realtime::log(a.cartesian.orientation * b.cartesian.orientation.conjugate()).norm();
}
double speed(const Reference& a) {
  return a.motion == Channels::kJoint ? a.joint.dq.norm() : a.cartesian.velocity.norm();
}

TEST_P(EveryTrajectory, begins_where_the_reference_is_and_ends_at_its_goal_at_rest) {
  for (int n = 0; n < 20; ++n) {
    const Generator motion = make();
    const Reference from = at_rest(motion_of(motion->fills()), random);
    motion->start(from);
    EXPECT_GE(motion->stretch(), 1 - 1e-12);
    Reference at;
    at.motion = from.motion;
    EXPECT_FALSE(motion->step(at_home(), 0, at));
    EXPECT_EQ(at.motion, motion_of(motion->fills()));
    EXPECT_LT(distance(at, from), 1e-9);
    EXPECT_FALSE(motion->step(at_home(), motion->duration() - 1e-6, at));
    EXPECT_LT(distance(at, motion->goal()), 1e-5);
    EXPECT_TRUE(motion->step(at_home(), motion->duration(), at));
    EXPECT_EQ(distance(at, motion->goal()), 0);
    EXPECT_EQ(speed(at), 0);
  }
}

TEST_P(EveryTrajectory, begins_where_its_path_begins_or_ends_to_the_last_bit) {
  const Generator motion = make();
  Reference from = at_rest(motion_of(motion->fills()), random), at;
  from.joint.q = home();
  from.cartesian.position = Vector3(0.4, 0, 0.4);
  from.cartesian.orientation.setIdentity();
  for (int n = 0; n < 2; ++n) {
    motion->start(from);
    for (double t = 0; !motion->step(at_home(), t, at); t += kDt) EXPECT_TRUE(is_finite(at)) << t;
    EXPECT_TRUE(is_finite(at));
    from = motion->goal();
  }
}

TEST_P(EveryTrajectory, goes_on_from_a_moving_reference) {
  const std::string& name = test.name;
  if (!name.ends_with("Dmp") && !name.ends_with("Waypoints") && !name.ends_with("Samples")) GTEST_SKIP() << "another law";
  for (int n = 0; n < 20; ++n) {
    const Generator motion = make();
    Reference from = at_rest(motion_of(motion->fills()), random);
    for (double& each : from.joint.dq) each = uniform(random, -0.3, 0.3);
    from.cartesian.velocity << 0.2 * direction(random), 0.4 * direction(random);
    motion->start(from);
    Reference at;
    EXPECT_FALSE(motion->step(at_home(), 0, at));
    EXPECT_LT(distance(at, from), 1e-9);
    const bool joint = from.motion == Channels::kJoint;
    EXPECT_LT(joint ? (at.joint.dq - from.joint.dq).norm() : (at.cartesian.velocity - from.cartesian.velocity).norm(), 1e-9);
    if (!name.ends_with("Dmp")) {
      EXPECT_LT(joint ? at.joint.ddq.norm() : at.cartesian.acceleration.norm(), 1e-9);
    }
    EXPECT_FALSE(motion->step(at_home(), motion->duration() - 1e-6, at));
    EXPECT_LT(distance(at, motion->goal()), 1e-5);
  }
}

TEST_P(EveryTrajectory, has_the_derivatives_of_its_positions) {
  constexpr double h = 1e-6;
  for (int n = 0; n < 10; ++n) {
    const Generator motion = make();
    motion->start(at_rest(motion_of(motion->fills()), random));
    int off = 0, samples = 0;
    for (double t = 0.0131; t < motion->duration() - 0.01; t += 0.0437, ++samples) {
      Reference before, at, after;
      motion->step(at_home(), t - h, before);
      motion->step(at_home(), t, at);
      motion->step(at_home(), t + h, after);
      Eigen::VectorXd v, dv, a, da;
      if (at.motion == Channels::kJoint) {
        v = at.joint.dq;
        a = at.joint.ddq;
        dv = (after.joint.q - before.joint.q) / (2 * h);
        da = (after.joint.dq - before.joint.dq) / (2 * h);
      } else {
        const auto &p = before.cartesian, &q = after.cartesian;
        v = at.cartesian.velocity;
        a = at.cartesian.acceleration;
        dv.resize(6);
        dv << (q.position - p.position) / (2 * h), realtime::log(q.orientation * p.orientation.conjugate()) / (2 * h);
        da = (q.velocity - p.velocity) / (2 * h);
      }
      off += (v - dv).norm() > 1e-5 || (a - da).norm() > 1e-2;
    }
    EXPECT_LE(off, 1 + samples / 50) << "of " << samples;  // a corner of the acceleration may lie between
  }
}

TEST_P(EveryTrajectory, is_followed_to_its_goal_inside_the_limits) {
  for (int n = 0; n < 8; ++n) {
    const Generator motion = make();
    const Reference from = at_rest(motion_of(motion->fills()), random);
    motion->start(from);
    realtime::Limiter limiter(limits);
    limiter.reset(from);
    Reference wanted, out;
    int held = 0, k = 0;
    while (!motion->step(at_home(), ++k * kDt, wanted)) held += limiter.follow(wanted, kDt, out);
    if (test.smooth) {
      EXPECT_EQ(held, 0) << "of " << k;
    }
    for (int more = 0; more < 3000 && limiter.follow(wanted, kDt, out); ++more) {
    }
    EXPECT_LT(distance(out, motion->goal()), 1e-9);
  }
}

TEST_P(EveryTrajectory, allocates_nothing_in_the_loop) {
  if (!allocations::kCounts) GTEST_SKIP() << "the heap belongs to a sanitizer";
  const Generator motion = make();
  const Reference from = at_rest(motion_of(motion->fills()), random);
  Reference at;
  const realtime::Cycle& cycle = at_home();
  testing_tools::AllocationCounter allocations;
  for (int n = 0; n < 10; ++n) {
    motion->start(from);
    for (double t = 0; !motion->step(cycle, t, at); t += 0.01) {
    }
  }
  EXPECT_EQ(allocations.count(), 0);
}

TEST(TimeLaws, cubic_hermite_begins_with_the_velocity_of_the_reference) {
  const models::Limits& limits = models::limits(models::arm("fr3"), 10);
  Reference from, at;
  from.joint.q = home();
  from.joint.dq = Vector7::Constant(0.2);
  realtime::TimedJoint motion(TimeLaw::kCubicHermite, {home().array() + 0.1, 2}, limits);
  motion.start(from);
  motion.step(at_home(), 0, at);
  EXPECT_LT((at.joint.dq - from.joint.dq).norm(), 1e-12);
}

TEST(TimeOptimal, doubles_its_time_with_half_of_the_speed_where_velocity_rules) {
  const models::Limits& limits = models::limits(models::arm("fer"), 5);
  Reference from;
  from.joint.q = home();
  Vector7 goal = home();
  goal[0] += 2;
  double before = 0;
  for (const double speed : {0.4, 0.2, 0.1}) {
    realtime::TimeOptimalJoint motion({goal, speed}, limits);
    motion.start(from);
    if (before > 0) {
      EXPECT_NEAR(motion.duration() / before, 2, 0.15);
    }
    before = motion.duration();
  }
  EXPECT_NEAR(before, 2 / (0.94 * 0.1 * limits.dq_max[0]), 0.1 * before);
}

TEST(Stay, keeps_still_also_when_it_begins_moving) {
  realtime::Stay stay(Channels::kJoint, 1);
  Reference from, at;
  from.joint.q = home();
  from.joint.dq.setOnes();
  stay.start(from);
  EXPECT_FALSE(stay.step(at_home(), 0.5, at));
  EXPECT_EQ(at.joint.q, from.joint.q);
  EXPECT_EQ(at.joint.dq, Vector7::Zero());
}

TEST(JointVelocities, beyond_the_range_are_told) {
  const models::Limits& limits = models::limits(models::arm("fr3"), 10);
  Reference from;
  from.joint.q = home();
  for (const double duration : {0.5, 30.0}) {
    realtime::JointVelocity motion({Vector7(0.2 * Vector7::Unit(0)), {}, duration}, limits);
    motion.start(from);
    EXPECT_EQ(motion.shortened(), duration > 10);
  }
}

}  // namespace
