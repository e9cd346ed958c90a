#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "allocation_counter.hpp"
#include "models/arm.hpp"
#include "realtime/limiter.hpp"
#include "realtime/model.hpp"
#include "realtime/pose_joints.hpp"
#include "realtime/rotation.hpp"
#include "dt.hpp"
#include "singular_posture.hpp"

namespace {

using realtime::Reference;
using realtime::Channels;
using realtime::Vector3;
using realtime::Vector7;

// The robot's judgement: backward differences over 1 ms, with the reference and its derivatives before
// the first sample known.
struct JointJudge {
  const models::Limits& limits;
  Vector7 q, v, a;
  double worst_v = 0, worst_a = 0, worst_j = 0, worst_q = 0;  // of the limits; worst_q in rad beyond

  JointJudge(const models::Limits& limits, const Reference& from) : limits(limits) {
    q = from.joint.q;
    v = from.joint.dq - kDt / 2 * from.joint.ddq;
    a = from.joint.ddq;
  }

  void see(const Vector7& next) {
    const Vector7 v1 = (next - q) / kDt;
    const Vector7 a1 = (v1 - v) / kDt;
    const Vector7 j1 = (a1 - a) / kDt;
    for (int i = 0; i < 7; ++i) {
      const double v_max = v1[i] > 0 ? limits.dq_upper(i, next[i]) : -limits.dq_lower(i, next[i]);
      if (std::abs(v1[i]) > 1e-9) worst_v = std::max(worst_v, std::abs(v1[i]) / std::max(v_max, 1e-9));
      worst_a = std::max(worst_a, std::abs(a1[i]) / limits.ddq_max[i]);
      worst_j = std::max(worst_j, std::abs(j1[i]) / limits.dddq_max[i]);
      worst_q = std::max({worst_q, next[i] - limits.q_max[i], limits.q_min[i] - next[i]});
    }
    q = next;
    v = v1;
    a = a1;
  }
  bool obeyed() const { return worst_v <= 1 && worst_a <= 1 && worst_j <= 1 && worst_q <= 0; }
  std::string text() const {
    return "velocity " + std::to_string(worst_v) + ", acceleration " + std::to_string(worst_a) + ", jerk " +
           std::to_string(worst_j) + " of the limits, position beyond by " + std::to_string(worst_q);
  }
};

struct PoseJudge {
  const models::Limits& limits;
  Vector3 p, w_v, w_a, v, a;
  Eigen::Quaterniond R;
  double worst = 0;  // of the limits

  PoseJudge(const models::Limits& limits, const Reference& from) : limits(limits) {
    p = from.cartesian.position;
    R = from.cartesian.orientation;
    v = from.cartesian.velocity.head<3>() - kDt / 2 * from.cartesian.acceleration.head<3>();
    a = from.cartesian.acceleration.head<3>();
    w_v = from.cartesian.velocity.tail<3>() - kDt / 2 * from.cartesian.acceleration.tail<3>();
    w_a = from.cartesian.acceleration.tail<3>();
  }

  void see(const realtime::CartesianReference& next) {
    judge((next.position - p) / kDt, v, a, limits.translation);
    const Eigen::AngleAxisd turn(next.orientation * R.conjugate());
    const double angle = turn.angle() > M_PI ? turn.angle() - 2 * M_PI : turn.angle();
    judge(turn.axis() * angle / kDt, w_v, w_a, limits.rotation);
    p = next.position;
    R = next.orientation;
  }
  void judge(const Vector3& v1, Vector3& v0, Vector3& a0, const models::Limits::Rates& rates) {
    const Vector3 a1 = (v1 - v0) / kDt;
    const Vector3 j1 = (a1 - a0) / kDt;
    worst = std::max({worst, v1.norm() / rates.velocity, a1.norm() / rates.acceleration, j1.norm() / rates.jerk});
    v0 = v1;
    a0 = a1;
  }
  bool obeyed() const { return worst <= 1; }
};

struct Case {
  const char* arm;
  std::uint16_t version;
};
std::string name_of(const testing::TestParamInfo<Case>& info) { return info.param.arm; }

class AnyArm : public testing::TestWithParam<Case> {
 protected:
  const models::Limits& limits = models::limits(models::arm(GetParam().arm), GetParam().version);
  std::mt19937 random{1234};
  double uniform(double low, double high) { return std::uniform_real_distribution<>(low, high)(random); }
  double gauss() { return std::normal_distribution<>()(random); }
  Vector3 direction() { return Vector3(gauss(), gauss(), gauss()).normalized(); }

  Reference joint_start() {
    Reference from;
    for (int i = 0; i < 7; ++i) {
      const double middle = (limits.q_min[i] + limits.q_max[i]) / 2;
      const double half = (limits.q_max[i] - limits.q_min[i]) / 2;
      from.joint.q[i] = middle + uniform(-0.3, 0.3) * half;
      const double room = std::min(limits.dq_upper(i, from.joint.q[i]), -limits.dq_lower(i, from.joint.q[i]));
      from.joint.dq[i] = uniform(-0.6, 0.6) * room;
      from.joint.ddq[i] = uniform(-0.9, 0.9) * limits.ddq_max[i];
    }
    return from;
  }

  Reference pose_start() {
    Reference from;
    from.motion = Channels::kPose;
    from.cartesian.position = Vector3(0.5, 0, 0.4);
    from.cartesian.orientation = realtime::exp(uniform(0, 3) * direction());
    from.cartesian.velocity << uniform(0, 0.9) * limits.translation.velocity * direction(),
        uniform(0, 0.9) * limits.rotation.velocity * direction();
    from.cartesian.acceleration << uniform(0, 0.9) * limits.translation.acceleration * direction(),
        uniform(0, 0.9) * limits.rotation.acceleration * direction();
    return from;
  }
};

INSTANTIATE_TEST_SUITE_P(Arms, AnyArm, testing::Values(Case{"fer", 5}, Case{"fr3", 10}), name_of);

// References nobody should send: steps across the range and beyond, ramps too fast, noise, NaN.
TEST_P(AnyArm, whatever_joint_reference_is_asked_for_the_output_obeys_the_limits) {
  for (int kind = 0; kind < 5; ++kind) {
    for (int trial = 0; trial < 12; ++trial) {
      const Reference from = joint_start();
      realtime::Limiter limiter(limits);
      limiter.reset(from);
      JointJudge asked(limits, from), got(limits, from);
      Reference wanted = from, out;
      Vector7 rate;
      for (int k = 0; k < 1500; ++k) {
        const double t = k * kDt;
        for (int i = 0; i < 7; ++i) {
          const double range = limits.q_max[i] - limits.q_min[i];
          if (kind == 0 && k % 400 == 0) {  // steps, sometimes outside of the range
            wanted.joint.q[i] = limits.q_min[i] + uniform(-0.2, 1.2) * range;
            wanted.joint.dq[i] = wanted.joint.ddq[i] = 0;
          } else if (kind == 1) {  // ramps up to twice as fast as allowed
            if (k % 300 == 0) rate[i] = uniform(-2, 2) * limits.dq_max[i];
            wanted.joint.q[i] += rate[i] * kDt;
            wanted.joint.dq[i] = rate[i];
            wanted.joint.ddq[i] = 0;
          } else if (kind == 2) {  // noise
            wanted.joint.q[i] = from.joint.q[i] + 0.01 * gauss();
            wanted.joint.dq[i] = 10 * gauss();
            wanted.joint.ddq[i] = 1000 * gauss();
          } else if (kind == 3) {  // a sine of too much of everything, now and then not a number
            const double w = 2 + 2 * i;
            wanted.joint.q[i] = from.joint.q[i] + 0.3 * range * std::sin(w * t);
            wanted.joint.dq[i] = 0.3 * range * w * std::cos(w * t);
            wanted.joint.ddq[i] = -0.3 * range * w * w * std::sin(w * t);
            if (k % 97 == 0 && i == k % 7) wanted.joint.q[i] = std::nan("");
          } else if (kind == 4) {  // velocities that say otherwise than the positions
            wanted.joint.q[i] = from.joint.q[i] + 0.2 * range * std::sin(3 * t);
            wanted.joint.dq[i] = uniform(-1, 1);
            wanted.joint.ddq[i] = -5;
          }
        }
        limiter.follow(wanted, kDt, out);
        asked.see(wanted.joint.q);
        got.see(out.joint.q);
        ASSERT_TRUE(got.obeyed()) << "kind " << kind << " trial " << trial << " cycle " << k << ": " << got.text();
      }
      EXPECT_FALSE(asked.obeyed()) << "kind " << kind << " asks for nothing forbidden";
    }
  }
}

TEST_P(AnyArm, whatever_pose_is_asked_for_the_output_obeys_the_limits) {
  for (int kind = 0; kind < 4; ++kind) {
    for (int trial = 0; trial < 12; ++trial) {
      const Reference from = pose_start();
      realtime::Limiter limiter(limits);
      limiter.reset(from);
      PoseJudge asked(limits, from), got(limits, from);
      Reference wanted = from, out;
      wanted.cartesian.velocity.setZero();
      wanted.cartesian.acceleration.setZero();
      for (int k = 0; k < 1500; ++k) {
        auto& pose = wanted.cartesian;
        if (kind == 0 && k % 400 == 0) {
          pose.position = 0.8 * direction();
          pose.orientation = realtime::exp(uniform(0, 3.1) * direction());
        } else if (kind == 1) {
          pose.position = from.cartesian.position + 0.3 * Vector3(std::sin(0.02 * k), std::cos(0.015 * k), 0);
          pose.orientation = realtime::exp(Vector3(2 * std::sin(0.01 * k), std::cos(0.02 * k), 0));
        } else if (kind == 2) {
          pose.position = from.cartesian.position + 0.01 * direction();
          pose.orientation = realtime::exp(0.05 * direction()) * from.cartesian.orientation;
          pose.velocity.setRandom();
        } else if (kind == 3 && k % 50 == 0) {
          pose.position = direction();
          pose.orientation.w() = k % 100 == 0 ? std::nan("") : 0.5;
        }
        limiter.follow(wanted, kDt, out);
        if (kind != 3) asked.see(wanted.cartesian);
        got.see(out.cartesian);
        ASSERT_TRUE(got.obeyed()) << "kind " << kind << " trial " << trial << " cycle " << k << ": " << got.worst;
      }
      if (kind != 3) {
        EXPECT_FALSE(asked.obeyed()) << "kind " << kind << " asks for nothing forbidden";
      }
    }
  }
}

// What the robot does with a pose: Newton's method from where the joints were, the elbow held.
Vector7 joints_at(realtime::Model& model, const realtime::CartesianReference& pose, Vector7 q) {
  for (int k = 0; k < 5; ++k) {
    const Eigen::Isometry3d T = model.O_T_EE(q);
    realtime::Vector6 error;
    error << pose.position - T.translation(),
        realtime::log(pose.orientation * Eigen::Quaterniond(T.linear()).conjugate());
    q += model.joints_of_pose(q).dq_dP * error;
  }
  return q;
}

TEST_P(AnyArm, joints_that_follow_a_pose_obey_their_limits_whatever_pose_is_asked_for) {
  realtime::Model model(models::urdf(models::arm(GetParam().arm), GetParam().version));
  double asked_most = 0;
  for (int kind = 0; kind < 4; ++kind) {
    for (int trial = 0; trial < 6; ++trial) {
      Reference from, wanted, out;
      from.motion = Channels::kPose;
      Vector7 q = Vector7::Map(models::kHome.data());
      const Eigen::Isometry3d home = model.O_T_EE(q);
      from.cartesian.position = home.translation();
      from.cartesian.orientation = home.linear();
      realtime::Limiter limiter(limits);
      limiter.reset(from);
      Reference joints;
      joints.joint.q = q;
      JointJudge got(limits, joints), asked(limits, joints);
      PoseJudge pose(limits, from);
      Vector7 q_wanted = q;
      wanted = from;
      for (int k = 0; k < 2500; ++k) {
        const double t = k * kDt;
        if (kind == 0 && k % 500 == 100) {  // steps
          wanted.cartesian.position = home.translation() + 0.15 * direction();
          wanted.cartesian.orientation = realtime::exp(0.4 * direction()) * Eigen::Quaterniond(home.linear());
        } else if (kind == 1 || kind == 2) {  // sines: all that the tool may, the joints not
          const double w = kind == 1 ? 3 + trial : 8;
          const Vector3 swing(0.1, 0.02 * (1 + trial), 0.05);
          wanted.cartesian.position = home.translation() + std::sin(w * t) * swing;
          wanted.cartesian.velocity.head<3>() = w * std::cos(w * t) * swing;
          wanted.cartesian.acceleration.head<3>() = -w * w * std::sin(w * t) * swing;
        } else if (kind == 3 && k > 1000) {  // a stop on the way
          limiter.joints_follow(model.joints_of_pose(q), model.joints_of_pose(limiter.joints_ahead(q)));
          limiter.brake(kDt, out);
        } else if (kind == 3) {
          wanted.cartesian.position = home.translation() + Vector3(0.1, 0.3, -0.2);
        }
        if (!(kind == 3 && k > 1000)) {
          limiter.joints_follow(model.joints_of_pose(q), model.joints_of_pose(limiter.joints_ahead(q)));
          limiter.follow(wanted, kDt, out);
        }
        q = joints_at(model, out.cartesian, q);
        got.see(q);
        pose.see(out.cartesian);
        ASSERT_TRUE(got.obeyed()) << "kind " << kind << " trial " << trial << " cycle " << k << ": " << got.text();
        ASSERT_TRUE(pose.obeyed()) << "kind " << kind << " trial " << trial << " cycle " << k << ": " << pose.worst;
        if (kind != 1 && kind != 2) continue;
        q_wanted = joints_at(model, wanted.cartesian, q_wanted);
        asked.see(q_wanted);
      }
      asked_most = std::max({asked_most, asked.worst_a});
    }
  }
  EXPECT_GT(asked_most, 1) << "nothing forbidden was asked for";
}

// A reference that rests but for rounding tells nothing of how the joints' map changes along the way.
TEST_P(AnyArm, a_pose_that_leaves_rest_gently_is_not_held) {
  realtime::Model model(models::urdf(models::arm(GetParam().arm), GetParam().version));
  Reference from;
  from.motion = Channels::kPose;
  const Vector7 q = Vector7::Map(models::kHome.data());
  from.cartesian.position = model.O_T_EE(q).translation();
  from.cartesian.orientation = Eigen::Quaterniond(model.O_T_EE(q).linear());
  from.cartesian.velocity.setConstant(1e-18);
  realtime::Limiter limiter(limits);
  limiter.reset(from);
  Reference wanted = from, out;
  for (int k = 1; k < 10; ++k) {
    const double t = k * kDt, jerk = 1;
    wanted.cartesian.position.x() = from.cartesian.position.x() + jerk * t * t * t / 6;
    wanted.cartesian.velocity[0] = jerk * t * t / 2;
    wanted.cartesian.acceleration[0] = jerk * t;
    realtime::JointsOfPose ahead = model.joints_of_pose(q);
    ahead.dq_dP.array() += 1e-8;
    limiter.joints_follow(model.joints_of_pose(q), ahead);
    EXPECT_FALSE(limiter.follow(wanted, kDt, out)) << "cycle " << k;
  }
}

// A pose that is to stay while it is in the midst of a motion turns back at once, however gently it would go there from rest.
TEST_P(AnyArm, a_pose_in_mid_motion_is_not_led_astray) {
  realtime::Model model(models::urdf(models::arm(GetParam().arm), GetParam().version));
  realtime::PoseJoints joints(model, limits);
  joints.place(Vector7::Map(models::kHome.data()));
  Reference from;
  from.motion = Channels::kPose;
  from.cartesian = realtime::at(model.O_T_EE(Vector7::Map(models::kHome.data())));
  const Reference wanted = from;
  from.cartesian.velocity[2] = 0.1;
  from.cartesian.acceleration[2] = 2.5;
  realtime::Limiter limiter(limits);
  limiter.reset(from);
  Reference out = from;
  double farthest = 0;
  int cycle = 0;
  for (; cycle < 4000; ++cycle) {
    joints.step(out.cartesian, kDt);
    limiter.joints_follow(joints.joints(), model.joints_of_pose(limiter.joints_ahead(joints.joints().q)));
    if (!limiter.follow(wanted, kDt, out)) break;
    farthest = std::max(farthest, (out.cartesian.position - wanted.cartesian.position).norm());
  }
  EXPECT_LT(cycle, 2000);
  EXPECT_LT(farthest, 0.09);
}

TEST_P(AnyArm, it_is_stuck_only_since_it_began_anew) {
  const Reference from = joint_start();
  realtime::Limiter limiter(limits);
  limiter.reset(from);
  Reference wanted = from, out;
  wanted.joint.q = Vector7::Map(limits.q_max.data()).array() + 0.1;
  wanted.joint.dq.setZero();
  wanted.joint.ddq.setZero();
  for (int k = 0; k < 60'000 && !limiter.stuck(); ++k) limiter.follow(wanted, kDt, out);
  ASSERT_TRUE(limiter.stuck());
  limiter.reset(limiter.last());
  EXPECT_FALSE(limiter.stuck());
}

TEST_P(AnyArm, a_reference_that_obeys_is_passed_on_unchanged) {
  for (int trial = 0; trial < 20; ++trial) {
    Reference wanted;
    const Vector7 middle = (Vector7::Map(limits.q_min.data()) + Vector7::Map(limits.q_max.data())) / 2;
    const double w = uniform(0.5, 4);
    const auto sine = [&](double t) {
      for (int i = 0; i < 7; ++i) {
        const double amplitude = 0.9 * std::min(0.8 * limits.dq_upper(i, middle[i]) / w, limits.ddq_max[i] / w / w);
        const double reach = std::min(amplitude, 0.3 * (limits.q_max[i] - middle[i]));
        wanted.joint.q[i] = middle[i] + reach * std::sin(w * t + i);
        wanted.joint.dq[i] = reach * w * std::cos(w * t + i);
        wanted.joint.ddq[i] = -reach * w * w * std::sin(w * t + i);
      }
    };
    sine(0);
    realtime::Limiter limiter(limits);
    limiter.reset(wanted);
    Reference out;
    for (int k = 1; k < 3000; ++k) {
      sine(k * kDt);
      ASSERT_FALSE(limiter.follow(wanted, kDt, out)) << "trial " << trial << " cycle " << k;
      ASSERT_EQ(out.joint.q, wanted.joint.q);
      ASSERT_EQ(out.joint.dq, wanted.joint.dq);
      ASSERT_EQ(out.joint.ddq, wanted.joint.ddq);
    }
  }
}

TEST_P(AnyArm, a_pose_reference_that_obeys_is_passed_on_unchanged) {
  Reference wanted;
  wanted.motion = Channels::kPose;
  const Vector3 axis = direction();
  const auto sine = [&](double t) {
    auto& pose = wanted.cartesian;
    pose.position = Vector3(0.5, 0.2 * std::sin(4 * t), 0.4);
    pose.orientation = realtime::exp(0.5 * std::sin(4 * t) * axis);
    pose.velocity << 0, 0.8 * std::cos(4 * t), 0, 2 * std::cos(4 * t) * axis;
    pose.acceleration << 0, -3.2 * std::sin(4 * t), 0, -8 * std::sin(4 * t) * axis;
  };
  sine(0);
  realtime::Limiter limiter(limits);
  limiter.reset(wanted);
  Reference out;
  for (int k = 1; k < 3000; ++k) {
    sine(k * kDt);
    ASSERT_FALSE(limiter.follow(wanted, kDt, out)) << "cycle " << k;
    ASSERT_EQ(out.cartesian.position, wanted.cartesian.position);
    ASSERT_EQ(out.cartesian.orientation.coeffs(), wanted.cartesian.orientation.coeffs());
  }
}

// A motion that waits is braked in every cycle.
TEST_P(AnyArm, what_leaves_a_rest_that_was_held_is_passed_on_at_once) {
  for (const Channels motion : {Channels::kJoint, Channels::kPose}) {
    Reference wanted;
    wanted.motion = motion;
    wanted.joint.q = (Vector7::Map(limits.q_min.data()) + Vector7::Map(limits.q_max.data())) / 2;
    wanted.cartesian.position = Vector3(0.5, 0, 0.4);
    realtime::Limiter limiter(limits);
    limiter.reset(wanted);
    Reference out = wanted;
    for (int k = 0; k < 10; ++k) ASSERT_TRUE(limiter.brake(kDt, out));
    for (int k = 1; k < 10; ++k) {  // a fifth of the jerk limit
      const double t = k * kDt;
      for (int i = 0; i < 7; ++i) {
        const double J = limits.dddq_max[i] / 5;
        wanted.joint.q[i] = out.joint.q[i] + J * (std::pow(t, 3) - std::pow(t - kDt, 3)) / 6;
        wanted.joint.dq[i] = J * t * t / 2;
        wanted.joint.ddq[i] = J * t;
      }
      const double J = limits.translation.jerk / 5;
      wanted.cartesian.position[2] = 0.4 - J * std::pow(t, 3) / 6;
      wanted.cartesian.velocity[2] = -J * t * t / 2;
      wanted.cartesian.acceleration[2] = -J * t;
      ASSERT_FALSE(limiter.follow(wanted, kDt, out)) << "cycle " << k;
    }
  }
}

TEST_P(AnyArm, after_a_step_it_catches_up_and_passes_on_again) {
  for (int trial = 0; trial < 10; ++trial) {
    const double step = uniform(-0.4, 0.4);
    Reference wanted;
    wanted.joint.q = (Vector7::Map(limits.q_min.data()) + Vector7::Map(limits.q_max.data())) / 2;
    const Vector7 middle = wanted.joint.q;
    realtime::Limiter limiter(limits);
    wanted.joint.dq.setConstant(0.1);
    limiter.reset(wanted);
    Reference out;
    bool held = true;
    int last_held = 0;
    for (int k = 1; k < 3000; ++k) {
      const double t = k * kDt;
      wanted.joint.q.array() = middle.array() + step + 0.1 * std::sin(t);
      wanted.joint.dq.setConstant(0.1 * std::cos(t));
      wanted.joint.ddq.setConstant(-0.1 * std::sin(t));
      held = limiter.follow(wanted, kDt, out);
      if (held) last_held = k;
    }
    EXPECT_GT(last_held, 5);
    EXPECT_LT(last_held, 1200) << "step of " << step;
    EXPECT_EQ(out.joint.q, wanted.joint.q);
  }
}

TEST_P(AnyArm, after_a_step_of_the_pose_it_catches_up_and_passes_on_again) {
  for (int trial = 0; trial < 10; ++trial) {
    Reference wanted = pose_start();
    realtime::Limiter limiter(limits);
    limiter.reset(wanted);
    const Vector3 p = wanted.cartesian.position + 0.3 * direction();
    const Vector3 axis = direction();
    const Eigen::Quaterniond R = realtime::exp(uniform(0.5, 2.8) * direction()) * wanted.cartesian.orientation;
    Reference out;
    int last_held = 0;
    for (int k = 1; k < 5000; ++k) {
      const double t = k * kDt;
      auto& pose = wanted.cartesian;
      pose.position = p + 0.1 * std::sin(t) * axis;
      pose.orientation = realtime::exp(0.2 * std::sin(t) * axis) * R;
      pose.velocity << 0.1 * std::cos(t) * axis, 0.2 * std::cos(t) * axis;
      pose.acceleration << -0.1 * std::sin(t) * axis, -0.2 * std::sin(t) * axis;
      if (limiter.follow(wanted, kDt, out)) last_held = k;
    }
    EXPECT_GT(last_held, 5);
    EXPECT_LT(last_held, 4500);
    EXPECT_EQ(out.cartesian.position, wanted.cartesian.position);
  }
}

TEST_P(AnyArm, braking_obeys_the_limits_and_ends_at_rest) {
  for (int trial = 0; trial < 50; ++trial) {
    for (const bool joint : {true, false}) {
      const Reference from = joint ? joint_start() : pose_start();
      realtime::Limiter limiter(limits);
      limiter.reset(from);
      EXPECT_FALSE(limiter.at_rest());
      JointJudge joints(limits, from);
      PoseJudge pose(limits, from);
      Reference out;
      int cycles = 0;
      while (!limiter.brake(kDt, out)) {
        ASSERT_LT(++cycles, 1500) << "does not come to rest";
        if (joint) joints.see(out.joint.q);
        if (!joint) pose.see(out.cartesian);
      }
      if (joint) {
        EXPECT_TRUE(joints.obeyed()) << joints.text();
      }
      if (!joint) {
        EXPECT_TRUE(pose.obeyed()) << pose.worst;
      }
      EXPECT_TRUE(limiter.at_rest());
      Reference still;
      limiter.brake(kDt, still);
      EXPECT_EQ(still.joint.q, out.joint.q);
      EXPECT_EQ(still.cartesian.position, out.cartesian.position);
    }
  }
}

TEST_P(AnyArm, coasting_continues_with_constant_acceleration) {
  const Reference from = joint_start();
  realtime::Limiter limiter(limits);
  limiter.reset(from);
  Reference out;
  for (int k = 1; k <= 5; ++k) limiter.coast(kDt, out);
  const double t = 5 * kDt;
  const Vector7 expected = from.joint.q + t * from.joint.dq + t * t / 2 * from.joint.ddq;
  EXPECT_LT((out.joint.q - expected).cwiseAbs().maxCoeff(), 1e-12);

  JointJudge judge(limits, out);
  for (int k = 0; k < 500; ++k) {
    Reference next;
    limiter.follow(from, kDt, next);
    judge.see(next.joint.q);
  }
  EXPECT_TRUE(judge.obeyed()) << judge.text();
}

// Inside every other limit.
TEST_P(AnyArm, more_jerk_than_the_arm_may_have_is_held_back) {
  Reference wanted = joint_start();
  realtime::Limiter limiter(limits);
  limiter.reset(wanted);
  JointJudge judge(limits, wanted);
  Reference out;
  int held = 0;
  for (int k = 0; k < 400; ++k) {
    constexpr double kShape[] = {1, 0, -1, 0};  // of an acceleration that comes and goes at once
    for (int i = 0; i < 7; ++i) {
      wanted.joint.ddq[i] = 0.9 * limits.ddq_max[i] * kShape[k % 4];
      ASSERT_GT(0.9 * limits.ddq_max[i], 1.1 * limits.dddq_max[i] * kDt);
    }
    wanted.joint.q += kDt * (wanted.joint.dq + kDt * wanted.joint.ddq);
    wanted.joint.dq += kDt * wanted.joint.ddq;
    held += limiter.follow(wanted, kDt, out);
    judge.see(out.joint.q);
  }
  EXPECT_TRUE(judge.obeyed()) << judge.text();
  EXPECT_GT(held, 300);
}

TEST_P(AnyArm, near_the_end_of_the_range_nothing_is_asked_for_that_cannot_be_stopped) {
  for (int i = 0; i < 7; ++i) {
    for (const double sign : {-1.0, 1.0}) {
      Reference wanted;
      wanted.joint.q = (Vector7::Map(limits.q_min.data()) + Vector7::Map(limits.q_max.data())) / 2;
      realtime::Limiter limiter(limits);
      limiter.reset(wanted);
      JointJudge judge(limits, wanted);
      Reference out;
      for (int k = 0; k < 4000; ++k) {
        wanted.joint.q[i] += sign * 0.8 * limits.dq_max[i] * kDt;
        wanted.joint.dq[i] = sign * 0.8 * limits.dq_max[i];
        limiter.follow(wanted, kDt, out);
        judge.see(out.joint.q);
      }
      EXPECT_TRUE(judge.obeyed()) << "joint " << i << ": " << judge.text();
      EXPECT_LT(std::abs(judge.v[i]), 0.05) << "joint " << i;
    }
  }
}

// Also where joints next to the ends of their ranges can not be braked as gently as others, or not with as little.
TEST_P(AnyArm, comes_to_rest_where_it_said) {
  for (const double spared : {1., 0.3}) {
    for (const bool soon : {false, true}) {
      double worst = 0;
      for (int trial = 0; trial < 30; ++trial) {
        Reference wanted;
        wanted.joint.q = (Vector7::Map(limits.q_min.data()) + Vector7::Map(limits.q_max.data())) / 2;
        realtime::Limiter limiter(limits);
        limiter.reset(wanted);
        limiter.spare(spared, 1);
        Reference out;
        for (int k = 0; k < 500 + 30 * trial; ++k) {
          for (int i = 0; i < 7; ++i) wanted.joint.dq[i] = (trial >> i & 1 ? -0.8 : 0.8) * limits.dq_max[i];
          wanted.joint.q += kDt * wanted.joint.dq;
          limiter.follow(wanted, kDt, out);
        }
        std::array<Vector7, 8> way;
        const std::size_t places = limiter.way_to_rest(way, soon);
        for (int k = 0; k < 3000 && !limiter.brake(kDt, out, soon); ++k) {
        }
        worst = std::max(worst, (out.joint.q - way[places - 1]).cwiseAbs().maxCoeff());
      }
      EXPECT_LT(worst, 0.015) << "rad, " << spared << (soon ? ", soon" : "");
    }
  }
}

Reference pose_at(const Eigen::Isometry3d& O_T_EE) {
  Reference out;
  out.motion = Channels::kPose;
  out.cartesian.position = O_T_EE.translation();
  out.cartesian.orientation = Eigen::Quaterniond(O_T_EE.linear());
  return out;
}

// The robot makes joints of a pose, with joint 3 at rest: Newton's method, damped next to singularities.
class RobotsJoints {
 public:
  RobotsJoints(realtime::Model& model, const Vector7& start) : q(start), model_(model) {}

  void follow(const realtime::CartesianReference& pose) {
    const Vector7 last = q;
    q += kDt * dq_;
    for (int k = 0; k < 4; ++k) {
      model_.update(q, Vector7::Zero());
      Vector7 error;
      error << pose.position - model_.O_T_EE().translation(),
          realtime::log(pose.orientation * Eigen::Quaterniond(model_.O_T_EE().linear()).conjugate()), last[2] - q[2];
      Eigen::Matrix<double, 7, 7> A;
      A << model_.jacobian(), Vector7::Unit(2).transpose();
      const double determinant = std::abs(A.determinant());
      const double damping = 0.02 * std::max(0., 1 - determinant / 5e-4);
      q += (A.transpose() * A + damping * damping * decltype(A)::Identity()).ldlt().solve(A.transpose() * error);
    }
    dq_ = (q - last) / kDt;
  }

  Vector7 q;

 private:
  realtime::Model& model_;
  Vector7 dq_ = Vector7::Zero();
};

TEST_P(AnyArm, joints_that_follow_any_pose_keep_their_limits_next_to_singularities_too) {
  realtime::Model model(models::urdf(models::arm(GetParam().arm), GetParam().version));
  model.set_tool(0, Vector3::Zero(), Eigen::Matrix3d::Zero(), Eigen::Isometry3d(Eigen::Translation3d(0, 0, 0.1034)));
  int held_cycles = 0, near = 0;
  for (int trial = 0; trial < 30; ++trial) {
    Reference home;
    for (int i = 0; i < 7; ++i) {
      home.joint.q[i] = std::clamp(models::kHome[i] + uniform(-1, 1), limits.q_min[i] + 0.2, limits.q_max[i] - 0.2);
    }
    const Reference from = pose_at(model.O_T_EE(home.joint.q));
    realtime::Limiter limiter(limits);
    limiter.reset(from);
    RobotsJoints joints(model, home.joint.q);
    JointJudge judge(limits, home);
    PoseJudge pose(limits, from);
    Reference wanted = from, out;
    // Twists for a while, steps of the pose, and stops.
    realtime::Vector6 twist = realtime::Vector6::Zero();
    for (int k = 0; k < 2000; ++k) {
      if (k % 400 == 0) {
        const double speed = uniform(0.05, 1);
        twist << speed * direction(), 2 * speed * direction();
        if (trial % 3 == 0) {
          twist.setZero();
          wanted = pose_at(model.O_T_EE(home.joint.q + 0.5 * Vector7::Random()));
        }
      }
      wanted.cartesian.position += kDt * twist.head<3>();
      wanted.cartesian.orientation = realtime::exp(kDt * twist.tail<3>()) * wanted.cartesian.orientation;
      wanted.cartesian.velocity = twist;
      limiter.joints_follow(model.joints_of_pose(joints.q), model.joints_of_pose(limiter.joints_ahead(joints.q)));
      const bool stop = k % 400 > 350;
      held_cycles += stop ? limiter.brake(kDt, out) : limiter.follow(wanted, kDt, out);
      if (stop) wanted = out;
      pose.see(out.cartesian);
      joints.follow(out.cartesian);
      near += std::abs((model.jacobian() * model.jacobian().transpose()).determinant()) < 1e-3;
      judge.see(joints.q);
      ASSERT_TRUE(judge.obeyed()) << "trial " << trial << " cycle " << k << ": " << judge.text();
    }
    EXPECT_TRUE(pose.obeyed()) << pose.worst;
  }
  EXPECT_GT(held_cycles, 1000);
  EXPECT_GT(near, 1000);
}

TEST_P(AnyArm, joints_keep_their_limits_where_a_pose_begins_next_to_a_singularity) {
  realtime::Model model(models::urdf(models::arm(GetParam().arm), GetParam().version));
  model.set_tool(0, Vector3::Zero(), Eigen::Matrix3d::Zero(), Eigen::Isometry3d(Eigen::Translation3d(0, 0, 0.1034)));
  int stayed = 0, left = 0;
  for (int trial = 0; trial < 40; ++trial) {
    Reference start;
    start.joint.q = singular_posture() + 0.01 * Vector7::Random();
    const Reference from = pose_at(model.O_T_EE(start.joint.q));
    realtime::Limiter limiter(limits);
    limiter.reset(from);
    RobotsJoints joints(model, start.joint.q);
    JointJudge judge(limits, start);
    Reference wanted, out = from;
    realtime::Vector6 twist;
    const double speed = std::pow(10, uniform(-4, -1));
    twist << speed * direction(), speed * direction();
    const auto determinant = [&] { return std::abs(model.joints_of_pose(joints.q).determinant); };
    const bool singular = determinant() < realtime::Limiter::kSingular;
    stayed += singular;
    for (int k = 0; k < 3000; ++k) {
      wanted = out;
      wanted.cartesian.position += kDt * twist.head<3>();
      wanted.cartesian.orientation = realtime::exp(kDt * twist.tail<3>()) * wanted.cartesian.orientation;
      wanted.cartesian.velocity = twist;
      limiter.joints_follow(model.joints_of_pose(joints.q), model.joints_of_pose(limiter.joints_ahead(joints.q)));
      limiter.follow(wanted, kDt, out);
      joints.follow(out.cartesian);
      judge.see(joints.q);
      ASSERT_TRUE(judge.obeyed()) << "trial " << trial << " cycle " << k << ": " << judge.text();
    }
    if (singular) {
      EXPECT_EQ(out.cartesian.position, from.cartesian.position) << "trial " << trial;
      EXPECT_FALSE(limiter.has_room());
    }
    left += determinant() > 1e-3;
  }
  EXPECT_GT(stayed, 5);
  EXPECT_GT(left, 5);
}

TEST_P(AnyArm, torque_and_its_rate_stay_within_the_limits) {
  realtime::TorqueLimiter limiter(limits);
  Vector7 last = Vector7::Zero(), out;
  bool broke = false;
  for (int k = 0; k < 5000; ++k) {
    Vector7 wanted = 200 * Vector7::Random();
    if (k % 11 == 0) wanted[k % 7] = std::nan("");
    if (k % 13 == 0) wanted[k % 7] = INFINITY;
    if (k > 2500) wanted.setConstant(200);
    EXPECT_TRUE(limiter.limit(wanted, last, kDt, out));
    Vector7 same = wanted;  // that what is wanted is also what comes out hides nothing
    EXPECT_TRUE(limiter.limit(same, last, kDt, same));
    EXPECT_EQ(same, out);
    for (int i = 0; i < 7; ++i) {
      ASSERT_LE(std::abs(out[i]), limits.tau_max[i]);
      ASSERT_LE(std::abs(out[i] - last[i]), limits.dtau_max[i] * kDt);
      broke |= std::abs(wanted[i]) > limits.tau_max[i];
    }
    last = out;
  }
  EXPECT_TRUE(broke);
  const Vector7 near = last.array() - 0.5;
  EXPECT_FALSE(limiter.limit(near, last, kDt, out));
  EXPECT_EQ(out, near);
}

// From rest at a position that was rounded on its way here: the robot's first velocity is not the one that was meant. Half of the
// outputs are lost, up to three in a row.
TEST_P(AnyArm, goes_on_from_what_the_robot_says_where_its_reference_is_another) {
  Reference from = joint_start();
  from.joint.dq.setZero();
  from.joint.ddq.setZero();
  const auto rounded = [](const Vector7& x) { return Vector7(x.cast<float>().cast<double>()); };
  for (int seed = 0; seed < 50; ++seed) {
    JointJudge robot(limits, from);
    Reference robots = from, out;
    robots.joint.q = rounded(robot.q);
    realtime::Limiter limiter(limits);
    limiter.reset(robots);
    Reference wanted = robots;
    std::mt19937 random(seed);
    for (int i = 0; i < 7; ++i) wanted.joint.q[i] += random() % 2 == 0 ? 0.1 : -0.1;
    for (int k = 0, lost = 0; k < 300; ++k) {
      limiter.follow(wanted, kDt, out);
      lost = random() % 2 == 0 && lost < 3 ? lost + 1 : 0;
      robot.see(lost > 0 ? Vector7(robot.q + kDt * (robot.v + kDt * robot.a)) : out.joint.q);
      robots.joint.q = rounded(robot.q);
      robots.joint.dq = rounded(robot.v);
      robots.joint.ddq = rounded(robot.a);
      limiter.reconcile(robots, 1, 3e-7, kDt, out);
    }
    EXPECT_TRUE(robot.obeyed()) << "seed " << seed << ": " << robot.text();
  }
}

TEST_P(AnyArm, the_limiter_allocates_nothing) {
  if (!allocations::kCounts) GTEST_SKIP() << "the heap belongs to a sanitizer";
  realtime::Limiter limiter(limits);
  Reference joint = joint_start(), pose = pose_start(), out;
  testing_tools::AllocationCounter allocations;
  for (const Reference& from : {joint, pose}) {
    limiter.reset(from);
    Reference wanted = from;
    for (int k = 0; k < 2000; ++k) {
      wanted.joint.q[k % 7] += k % 100 == 0 ? 0.1 : 1e-5;
      wanted.cartesian.position.x() += k % 100 == 0 ? 0.1 : 1e-5;
      limiter.follow(wanted, kDt, out);
    }
    while (!limiter.brake(kDt, out)) {
    }
    limiter.coast(kDt, out);
  }
  EXPECT_EQ(allocations.count(), 0);
}

}  // namespace
