// Dynamic movement primitives: against their differential equation, integrated here in another way, and in closed form.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "models/arm.hpp"
#include "realtime/joint_range.hpp"
#include "realtime/rotation.hpp"
#include "realtime/trajectories/joint_dmp.hpp"
#include "realtime/trajectories/pose_dmp.hpp"
#include "realtime/trajectories/quaternion_pose_dmp.hpp"
#include "tests/parts/refusal.hpp"
#include "tests/realtime/at_home.hpp"
#include "tests/realtime/home.hpp"

namespace {

using realtime::DmpForce;
using realtime::DmpSpring;
using realtime::FirstBasis;
using realtime::JointDmp;
using realtime::PoseDmp;
using realtime::QuaternionPoseDmp;
using realtime::Reference;
using realtime::Channels;
using realtime::Vector3;
using realtime::Vector7;

const models::Limits& limits = models::limits(models::arm("fer"), 5);

Reference joints() {
  Reference from;
  from.joint.q = home();
  return from;
}
Reference pose() {
  Reference from;
  from.motion = Channels::kPose;
  from.cartesian.position = {0.4, 0.1, 0.4};
  from.cartesian.orientation = realtime::exp({0.2, -0.1, 0.3}) * Eigen::Quaterniond(0, 1, 0, 0);
  return from;
}

DmpForce force(int dimensions, int sensors, double most, unsigned seed = 3) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<> weight(-most, most);
  DmpForce force;
  for (int k = 0; k < 6; ++k) {
    force.mu.push_back(std::exp(-0.1 * k));
    force.h.push_back(100 + 10 * k);
  }
  for (int i = 0; i < 6 * dimensions * sensors; ++i) force.weights.push_back(weight(random));
  return force;
}

// What the law says of one dimension, in small steps of Euler's (second order by halving them).
double integrated(const DmpSpring& spring, const std::function<double(double x, double t)>& f, double y0, double dy0,
                  double T) {
  const auto run = [&](int steps) {
    const double dt = T / steps;
    double y = y0, dy = dy0, x = 1;
    for (int n = 0; n < steps; ++n) {
      const double ddy =
          spring.tau * spring.tau *
          (spring.alpha * (spring.beta * (y0 - y) - dy / spring.tau) + spring.alpha * spring.beta * f(x, n * dt));
      y += dt * dy;
      dy += dt * ddy;
      x -= dt * spring.tau * x;
    }
    return y;
  };
  return 2 * run(40000) - run(20000);
}

double gaussians(const DmpForce& force, const double* weights, double x, std::size_t first) {
  double sum = 0, f = 0;
  for (std::size_t k = first; k < force.mu.size(); ++k) {
    const double psi = std::exp(-force.h[k] * std::pow(x - force.mu[k], 2));
    sum += psi;
    f += psi * weights[k];
  }
  return f * x / sum;
}

TEST(JointDmps, keep_their_differential_equation_from_rest_and_moving) {
  const DmpSpring spring{0.25, 20, 4};
  DmpForce learned = force(7, 2, 0.2);
  learned.initial_sensor_values = {0.7, -0.4};
  JointDmp motion({spring, learned, 2}, limits);
  Reference from = joints(), at;
  from.joint.dq << 0.1, -0.2, 0.05, 0, 0.3, 0, -0.1;
  motion.start(from);
  ASSERT_EQ(motion.stretch(), 1);
  for (const double t : {0.1234, 0.9, 1.9999}) {
    motion.step(at_home(), t, at);
    for (int i = 0; i < 7; ++i) {
      const double y = integrated(
          spring,
          [&](double x, double time) {
            double f = 0;
            for (int s = 0; s < 2; ++s) {
              const double* weights = learned.weights.data() + (i * 2 + s) * 6;
              const double u = std::min(2 * spring.tau * time, 1.0);
              f += learned.initial_sensor_values[s] *
                   (gaussians(learned, weights, x, 1) + weights[0] * u * u * u * (10 - 15 * u + 6 * u * u));
            }
            return f;
          },
          from.joint.q[i], from.joint.dq[i], t);
      EXPECT_NEAR(at.joint.q[i], y, 2e-7) << i << " at " << t;
    }
  }
}

realtime::SensorSample sent(const std::vector<double>& values) {
  realtime::SensorSample sample;
  sample.values.fill(NAN);
  std::copy(values.begin(), values.end(), sample.values.begin());
  return sample;
}

TEST(JointDmps, keep_their_differential_equation_with_values_of_sensors_that_come_while_they_run) {
  const DmpSpring spring{0.25, 20, 4};
  DmpForce learned = force(7, 2, 0.1);
  learned.initial_sensor_values = {0.7, -0.4};
  learned.topic = "sensors";
  JointDmp motion({spring, learned, 2}, limits);
  const auto input = motion.sensor_inputs().at(0);
  EXPECT_EQ(input->topic(), "sensors");
  Reference from = joints(), at;
  from.joint.dq << 0.1, -0.2, 0.05, 0, 0.3, 0, -0.1;
  struct Change {
    double t;
    std::vector<double> values;
  };
  const std::vector<Change> changes = {{0, {0.7, -0.4}}, {0.5, {0.2, 0.9}}, {0.8, {-0.5, 0.9}}};
  for (int round = 0; round < 2; ++round) {  // the second begins with the initial values again
    motion.start(from);
    ASSERT_EQ(motion.stretch(), 1);
    Reference goal;
    for (const double t : {0.4, 0.5, 0.7, 0.8, 0.9, 1.5, 1.9999}) {
      Reference before;
      for (const Change& change : changes) {
        if (t != change.t) continue;
        motion.step(at_home(), t, before);
        ASSERT_TRUE(input->put(sent(change.values)));
      }
      motion.step(at_home(), t, at);
      if (before.joint.q[0] != 0) {
        EXPECT_LT((at.joint.q - before.joint.q).norm(), 1e-12);
        EXPECT_LT((at.joint.dq - before.joint.dq).norm(), 1e-12);
        EXPECT_GT((at.joint.ddq - before.joint.ddq).norm(), 1e-3);
      }
      for (int i = 0; i < 7; ++i) {
        const double y = integrated(
            spring,
            [&](double x, double time) {
              const Change* now = &changes[0];
              for (const Change& change : changes) now = time >= change.t ? &change : now;
              double f = 0;
              for (int s = 0; s < 2; ++s) {
                const double* weights = learned.weights.data() + (i * 2 + s) * 6;
                const double u = std::min(2 * spring.tau * time, 1.0);
                f += now->values[static_cast<std::size_t>(s)] *
                     (gaussians(learned, weights, x, 1) + weights[0] * u * u * u * (10 - 15 * u + 6 * u * u));
              }
              return f;
            },
            from.joint.q[i], from.joint.dq[i], t);
        EXPECT_NEAR(at.joint.q[i], y, 2e-5) << i << " at " << t;  // its steps do not meet the changes
      }
    }
    EXPECT_TRUE(motion.step(at_home(), motion.duration(), at));
    EXPECT_EQ(at.joint.q, motion.goal().joint.q);
    Reference last;
    motion.step(at_home(), motion.duration() - 1e-6, last);
    EXPECT_LT((last.joint.q - at.joint.q).norm(), 1e-6);
  }
}

TEST(PoseDmps, take_values_of_sensors_of_each_dimension) {
  DmpForce learned = force(3, 2, 0.1);
  learned.topic = "sensors";
  const PoseDmp::Parameters parameters{{0.25, 25, 6}, learned, 2, PoseDmp::Dimensions::kPosition, false};
  PoseDmp motion(FirstBasis::kMinJerk, parameters, limits);
  const std::vector<double> values = {0.5, 0, 1, -1, 0, 0.3};
  DmpForce other = learned;
  other.topic.reset();
  other.initial_sensor_values = values;
  PoseDmp expected(FirstBasis::kMinJerk, {parameters.spring, other, 2, PoseDmp::Dimensions::kPosition, false}, limits);
  motion.start(pose());
  expected.start(pose());
  const auto input = motion.sensor_inputs().at(0);
  EXPECT_EQ(input->check(sent({1, 2})), "2 values: expected 6");
  EXPECT_EQ(input->check(sent(values)), "");
  ASSERT_TRUE(input->put(sent(values)));  // before its first cycle
  Reference at, as;
  for (double t = 0; t < 2; t += 0.1) {  // beyond, the time that it takes to rest is that of the initial values
    motion.step(at_home(), t, at);
    expected.step(at_home(), t, as);
    EXPECT_LT((at.cartesian.position - as.cartesian.position).norm(), 1e-9) << t;
  }
}

// Of a step of the goal a critically damped spring makes 1 - (1 + w t) exp(-w t).
TEST(GoalPoseDmps, answer_a_goal_as_a_spring_does) {
  const double tau = 0.5, alpha = 16, beta = 4, w = tau * alpha / 2;
  DmpForce goal{{1, 0.8}, {50, 50}, std::vector<double>(12, 0.0), {}};
  goal.weights[0] = 0.08;
  goal.weights[4] = -0.05;
  PoseDmp motion(FirstBasis::kGoal, {{tau, alpha, beta}, goal, 3}, limits);
  Reference at;
  motion.start(pose());
  ASSERT_EQ(motion.stretch(), 1);
  for (double t = 0.05; t < 3; t += 0.1) {
    motion.step(at_home(), t, at);
    const double way = 1 - (1 + w * t) * std::exp(-w * t);
    EXPECT_LT((at.cartesian.position - pose().cartesian.position - way * Vector3(0.08, 0, -0.05)).norm(), 1e-10);
    EXPECT_LT(at.cartesian.orientation.angularDistance(pose().cartesian.orientation), 1e-9);
  }
}

TEST(PoseDmps, end_so_far_from_their_start_as_the_first_weight_says) {
  DmpForce far{{1, 0.8}, {50, 50}, std::vector<double>(12, 0.0), {}};
  const double way[] = {0.05, -0.1, 0.03, 0.3, -0.2, 0.4};
  for (int i = 0; i < 6; ++i) far.weights[2 * i] = way[i];
  PoseDmp motion(FirstBasis::kMinJerk, {{0.25, 400, 100}, far, 2.5}, limits);  // it rises in 2 s
  for (const bool moving : {false, true}) {
    Reference from = pose(), at;
    if (moving) from.cartesian.velocity << 0.1, 0.2, -0.1, 0.3, -0.3, 0.2;
    motion.start(from);
    EXPECT_LT((motion.goal().cartesian.position - from.cartesian.position - Vector3(0.05, -0.1, 0.03)).norm(), 1e-6);
    // Its angles are those of Rx Ry Rz.
    const auto angles = [](const Eigen::Quaterniond& q) {
      const Eigen::Matrix3d R = q.toRotationMatrix();
      return Vector3(std::atan2(-R(1, 2), R(2, 2)), std::asin(R(0, 2)), std::atan2(-R(0, 1), R(0, 0)));
    };
    Vector3 turned = angles(motion.goal().cartesian.orientation) - angles(from.cartesian.orientation);
    for (double& each : turned) each = std::remainder(each, 2 * M_PI);
    EXPECT_LT((turned - Vector3(0.3, -0.2, 0.4)).norm(), 1e-6) << turned.transpose();
  }
}

TEST(PoseDmps, of_three_dimensions_leave_the_others) {
  const Reference from = pose();
  Reference at;
  for (const bool position : {true, false}) {
    PoseDmp motion(FirstBasis::kMinJerk,
                   {{0.25, 25, 6},
                    force(3, 1, 0.2),
                    2,
                    position ? PoseDmp::Dimensions::kPosition : PoseDmp::Dimensions::kOrientation,
                    false},
                   limits);
    motion.start(from);
    for (double t = 0; t < 2; t += 0.1) {
      motion.step(at_home(), t, at);
      const double moved = (at.cartesian.position - from.cartesian.position).norm();
      const double turned = at.cartesian.orientation.angularDistance(from.cartesian.orientation);
      EXPECT_LT(position ? turned : moved, 1e-12);
      EXPECT_GT((position ? moved : turned) + (t < 1), 1e-3);
    }
  }
}

TEST(PoseDmps, in_the_frame_of_the_end_effector_go_along_its_axes_at_the_start) {
  const PoseDmp::Parameters in_base{{0.25, 25, 6}, force(3, 1, 0.2), 2, PoseDmp::Dimensions::kPosition, false};
  PoseDmp::Parameters in_hand = in_base;
  in_hand.ee_frame = true;
  PoseDmp base(FirstBasis::kMinJerk, in_base, limits), hand(FirstBasis::kMinJerk, in_hand, limits);
  const Reference from = pose();
  Reference a, b;
  base.start(from);
  hand.start(from);
  for (double t = 0; t < 2; t += 0.1) {
    base.step(at_home(), t, a);
    hand.step(at_home(), t, b);
    const Vector3 way = a.cartesian.position - from.cartesian.position;
    EXPECT_LT((b.cartesian.position - from.cartesian.position - from.cartesian.orientation * way).norm(), 1e-12);
  }
}

// Without a force, and turning about one axis, the angle left is that of the spring; with one it is pushed along.
TEST(QuaternionPoseDmps, turn_to_their_goal_as_the_spring_of_unit_quaternions) {
  const double T = 1.5, alpha = 24, beta = 6, w = alpha / (2 * T), angle = 0.9;
  const Vector3 axis = Vector3(1, 2, -2) / 3;
  const Reference from = pose();
  QuaternionPoseDmp::Parameters parameters{{0.25, 25, 6},
                                           force(3, 1, 0.1),
                                           alpha,
                                           beta,
                                           force(3, 1, 0),
                                           realtime::exp(angle * axis) * from.cartesian.orientation,
                                           T,
                                           2,
                                           false};
  QuaternionPoseDmp motion(parameters, limits);
  motion.start(from);
  Reference at;
  const double s = motion.stretch();
  for (double t = 0.1; t < 1.9; t += 0.2) {
    motion.step(at_home(), s * t, at);
    const double left = angle * (1 + w * t) * std::exp(-w * t);
    EXPECT_NEAR(at.cartesian.orientation.angularDistance(parameters.goal), left, 1e-8);
  }
  // Pushed: against the law itself, of a turn about one axis.
  parameters.force = DmpForce{{1, 0.7, 0.4}, {20, 20, 20}, {}, {}};
  const double push[] = {30, -20, 25};
  for (int i = 0; i < 3; ++i) {
    for (double each : push) parameters.force.weights.push_back(each * axis[i]);
  }
  QuaternionPoseDmp pushed(parameters, limits);
  pushed.start(from);
  const double slower = pushed.stretch();
  for (const double end : {0.4, 1.4, 1.9}) {
    const auto run = [&](int steps) {
      double r = -angle, dr = 0;
      const double dt = end / steps;
      for (int n = 0; n < steps; ++n) {
        const double t = n * dt;
        const double f = t <= T ? gaussians(parameters.force, push, std::exp(-t / T), 0) : 0;
        const double ddr = (alpha * (-beta * r - T * dr) + f) / (T * T);
        r += dt * dr;
        dr += dt * ddr;
      }
      return r;
    };
    const double r = 2 * run(40000) - run(20000);
    pushed.step(at_home(), slower * end, at);
    const Eigen::Quaterniond expected = realtime::exp(r * axis) * parameters.goal;
    EXPECT_LT(at.cartesian.orientation.angularDistance(expected), 2e-5) << end;
  }
}

TEST(Dmps, are_slower_where_the_limits_ask_for_it) {
  DmpForce learned = force(7, 1, 0.05);
  for (int i = 0; i < 7; ++i) learned.weights[6 * i] = 0.5;
  for (const double T : {0.1, 0.5, 10.0}) {
    JointDmp motion({{0.5 / T, 25, 6}, learned, T}, limits);
    motion.start(joints());
    EXPECT_EQ(motion.stretch() > 1, T < 1);
    EXPECT_GE(motion.duration(), T * motion.stretch());
    EXPECT_LT(motion.duration(), T * motion.stretch() + 0.4);  // until what was cut off has come to rest
    Reference at;
    double used = 0;
    for (double t = 0; t < motion.duration(); t += motion.duration() / 1000) {
      motion.step(at_home(), t, at);
      for (int i = 0; i < 7; ++i) {
        used = std::max(
            {used, std::abs(at.joint.dq[i]) / limits.dq_max[i], std::abs(at.joint.ddq[i]) / limits.ddq_max[i]});
      }
    }
    EXPECT_LT(used, 0.95);
  }
}

TEST(Dmps, that_lead_out_of_the_range_say_so) {
  DmpForce learned = force(7, 1, 0);
  learned.weights[0] = 4;
  JointDmp motion({{0.25, 400, 100}, learned, 2.5}, limits);
  motion.start(joints());
  EXPECT_TRUE(motion.shortened());
  EXPECT_EQ(motion.goal().joint.q[0], realtime::rest_max(limits, 0));
}

TEST(Dmps, refuse_what_does_not_fit_by_name) {
  const auto joint = [](DmpForce force, DmpSpring spring = {0.25, 25, 6}, double duration = 2) {
    return refusal([&] { JointDmp({spring, force, duration}, limits); });
  };
  DmpForce good = force(7, 2, 0.1);
  good.initial_sensor_values = {1, 1};
  EXPECT_EQ(joint(good), "accepted");
  DmpForce bad = good;
  bad.h.pop_back();
  EXPECT_EQ(joint(bad), "h has 5 elements: expected 6, as mu has");
  bad = good;
  bad.weights.pop_back();
  EXPECT_TRUE(joint(bad).starts_with("weights has 83 elements: expected 42, one for each")) << joint(bad);
  bad = good;
  bad.initial_sensor_values = {1, 1, 1};
  EXPECT_TRUE(joint(bad).starts_with("weights has 84 elements")) << joint(bad);
  bad = good;
  bad.weights[8] = NAN;
  EXPECT_TRUE(joint(bad).starts_with("weights[8] is nan")) << joint(bad);
  bad = good;
  bad.mu.assign(200, 1);
  EXPECT_EQ(joint(bad), "mu has 200 elements: expected 1 to 100");
  bad = force(7, 9, 0.1);
  bad.topic = "sensors";
  EXPECT_EQ(joint(bad), "sensors with a topic has 9 elements: expected at most 8");
  EXPECT_TRUE(joint(good, {100, 25, 6}).starts_with("natural frequency of tau, alpha and beta is 2500"));
  EXPECT_TRUE(joint(good, {0.25, 25, 6}, 500).starts_with("duration is 500"));
  EXPECT_TRUE(
      refusal([&] {
        QuaternionPoseDmp({{0.25, 25, 6}, force(3, 1, 1), 25, 6, force(2, 1, 1), {1, 0, 0, 0}, 1, 2, false}, limits);
      }).starts_with("quat_weights has 12 elements"));
}

}  // namespace
