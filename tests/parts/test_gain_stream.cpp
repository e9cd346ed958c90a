// Parts that take gains, torques and forces from a topic.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <limits>
#include <memory>

#include "models/arm.hpp"
#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/controllers/force_position.hpp"
#include "realtime/controllers/gain_stream.hpp"
#include "realtime/controllers/pass_through_joint_torque.hpp"
#include "realtime/tick.hpp"
#include "realtime/trajectories/stream_force_position.hpp"
#include "tests/realtime/allocation_counter.hpp"
#include "tests/realtime/at_home.hpp"
#include "tests/realtime/simulated_arm.hpp"

namespace realtime {
namespace {

using testing_tools::SimulatedArm;

constexpr double kNotGiven = std::numeric_limits<double>::quiet_NaN();
constexpr int kRampCycles = 100;

// A message whose numbers from `first` on are these, and whose others are not given.
template <int N>
SensorSample sample_of(std::size_t first, const Eigen::Matrix<double, N, 1>& values) {
  SensorSample sample;
  sample.values.fill(kNotGiven);
  Eigen::Matrix<double, N, 1>::Map(sample.values.data() + first) = values;
  return sample;
}

void any(const Vector3&) {}

TEST(GainStream, GoesToWhatIsSentInAStraightLineAndKeepsWhatIsNotGiven) {
  GainStream<3> gains(Vector3(1, 2, 3), "gains", "Message", 2, any);
  ASSERT_EQ(gains.inputs().size(), 1u);
  gains.step(kTick);
  EXPECT_EQ(gains.now(), Vector3(1, 2, 3));
  gains.inputs()[0]->put(sample_of<3>(2, {11, kNotGiven, -7}));
  for (int i = 1; i <= kRampCycles; ++i) {
    gains.step(kTick);
    EXPECT_LT((gains.now() - Vector3(1 + 0.1 * i, 2, 3 - 0.1 * i)).norm(), 1e-9) << i;
  }
  gains.step(kTick);
  EXPECT_EQ(gains.now(), Vector3(11, 2, -7));
}

TEST(GainStream, NoMessageIsLostAndANewOneBeginsWhereItIs) {
  GainStream<3> gains(Vector3::Zero(), "gains", "Message", 0, any);
  const auto input = gains.inputs()[0];
  input->put(sample_of<3>(0, {10, kNotGiven, kNotGiven}));
  input->put(sample_of<3>(0, {kNotGiven, 20, kNotGiven}));
  for (int i = 0; i < kRampCycles / 2; ++i) gains.step(kTick);
  EXPECT_LT((gains.now() - Vector3(5, 10, 0)).norm(), 1e-9);
  input->put(sample_of<3>(0, {0, 0, kNotGiven}));
  Vector3 before = gains.now();
  for (int i = 0; i < kRampCycles; ++i) {
    gains.step(kTick);
    EXPECT_LT((gains.now() - before).norm(), 0.2);
    before = gains.now();
  }
  EXPECT_LT(gains.now().norm(), 1e-12);
}

// Of which one state in four comes.
TEST(GainStream, TimeIsTheRobotsWhereStatesAreLost) {
  GainStream<3> gains(Vector3::Zero(), "gains", "Message", 0, any);
  gains.inputs()[0]->put(sample_of<3>(0, {8, 0, 0}));
  for (int i = 1; i <= kRampCycles / 4; ++i) {
    gains.step(4 * kTick);
    EXPECT_NEAR(gains.now()[0], 0.32 * i, 1e-9);
  }
  EXPECT_EQ(gains.now()[0], 8);
  EXPECT_NEAR(gains.silent(), 0.096, 1e-9);
}

TEST(GainStream, WithoutATopicNothingIsListenedTo) {
  GainStream<3> gains(Vector3(1, 2, 3), std::nullopt, "Message", 0, any);
  EXPECT_FALSE(gains.changes());
  EXPECT_TRUE(gains.inputs().empty());
  EXPECT_THROW(GainStream<3>(Vector3::Zero(), "", "Message", 0, any), std::invalid_argument);
  const auto none = [](const Vector3&) { throw std::invalid_argument("none is right"); };
  EXPECT_THROW(GainStream<3>(Vector3::Zero(), std::nullopt, "Message", 0, none), std::invalid_argument);
}

class Streamed : public testing::Test {
 protected:
  SimulatedArm arm{"fr3"};
  const Vector7 stiffness = (Vector7() << 600, 600, 600, 600, 250, 150, 50).finished();
  const Vector7 damping = (Vector7() << 50, 50, 50, 50, 30, 25, 15).finished();

  PassThroughJointTorque::Parameters held() const {
    return {Vector7::Zero(), Vector7::Zero(), Vector7::Zero(), stiffness, damping, "torques"};
  }
  ForcePosition::Parameters position() const {
    Vector6 K;
    K << 600, 600, 600, 50, 50, 50;
    return {Vector6::Ones(), true, K, Vector6::Constant(0.1), stiffness, Vector7::Constant(0.1), 0.01, "gains"};
  }
};

TEST_F(Streamed, TorquesComeAtOnceAndTheirJointsAreGivenFreeInTime) {
  PassThroughJointTorque law(held(), arm.model.mass());
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  Vector7 selection = Vector7::Ones(), torque = Vector7::Zero();
  torque[6] = 3;
  Eigen::Matrix<double, 35, 1> sent = Eigen::Matrix<double, 35, 1>::Constant(kNotGiven);
  sent.segment<7>(0) = selection;
  sent.segment<7>(14) = torque;
  law.sensor_inputs()[0]->put(sample_of<35>(2, sent));
  Vector7 tau;
  for (int i = 1; i <= kRampCycles; ++i) {
    law.step(arm.cycle, reference, tau);
    EXPECT_NEAR(tau[6] - arm.model.coriolis()[6], 3.0 * i / kRampCycles, 1e-9);
  }
  torque[6] = -2;
  sent.segment<7>(14) = torque;
  law.sensor_inputs()[0]->put(sample_of<35>(2, sent));
  law.step(arm.cycle, reference, tau);
  EXPECT_NEAR(tau[6] - arm.model.coriolis()[6], -2, 1e-9);
}

TEST_F(Streamed, SpringsThatNoLoopCouldHoldAreRefused) {
  PassThroughJointTorque law(held(), arm.model.mass());
  Eigen::Matrix<double, 35, 1> sent = Eigen::Matrix<double, 35, 1>::Constant(kNotGiven);
  sent.segment<7>(14).setZero();
  EXPECT_EQ(law.sensor_inputs()[0]->check(sample_of<35>(2, sent)), "");
  sent.segment<7>(28).setConstant(200);
  EXPECT_NE(law.sensor_inputs()[0]->check(sample_of<35>(2, sent)).find("damping["), std::string::npos);
}

TEST_F(Streamed, JointGainsThatNoLoopCouldHoldAreRefusedWhereTheyAreUsed) {
  ForcePosition::Parameters of_joints = position(), wild = position();
  of_joints.use_cartesian_gains = false;
  ForcePosition law(of_joints, arm.model.mass()), of_EE(position(), arm.model.mass());
  Eigen::Matrix<double, 32, 1> sent = Eigen::Matrix<double, 32, 1>::Constant(kNotGiven);
  sent[12] = 3000;
  EXPECT_EQ(law.sensor_inputs()[0]->check(sample_of<32>(2, sent)), "");
  sent[18] = 3000;
  EXPECT_NE(law.sensor_inputs()[0]->check(sample_of<32>(2, sent)).find("position_kps_joint)[6] is "), std::string::npos);
  EXPECT_EQ(of_EE.sensor_inputs()[0]->check(sample_of<32>(2, sent)), "");
  wild.position_kps_joint[5] = 3000;
  ForcePosition unused(wild, arm.model.mass());
  wild.use_cartesian_gains = false;
  try {
    ForcePosition(wild, arm.model.mass());
    ADD_FAILURE() << "not refused";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("position_kps_joint)[5] is "), std::string::npos) << error.what();
  }
}

TEST_F(Streamed, APositionBecomesAForce) {
  ForcePosition law(position());
  EXPECT_FALSE(law.tracks());  // it may be asked for force at any time
  const auto input = law.sensor_inputs()[0];
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  reference.wrench[2] = 5;
  Vector7 tau;
  law.step(arm.cycle, reference, tau);
  EXPECT_LT((tau - arm.model.coriolis()).norm(), 1e-6);
  Eigen::Matrix<double, 32, 1> sent = Eigen::Matrix<double, 32, 1>::Constant(kNotGiven);
  sent.tail<6>() << 1, 1, 0, 1, 1, 1;
  EXPECT_EQ(input->check(sample_of<32>(2, sent)), "");
  input->put(sample_of<32>(2, sent));
  Vector7 before = tau;
  for (int i = 0; i <= kRampCycles; ++i) {
    law.step(arm.cycle, reference, tau);
    EXPECT_LT((tau - before).norm(), 0.5);  // N m in a cycle
    before = tau;
  }
  EXPECT_GT((tau - arm.model.coriolis()).norm(), 0.1);
  sent[7] = 3;  // force_kps_cart
  EXPECT_NE(input->check(sample_of<32>(2, sent)).find("force_kps_cart[1] is"), std::string::npos);
}

TEST_F(Streamed, ASpringBecomesStifferWithoutAStepOfTorque) {
  CartesianImpedance::Parameters parameters{Vector3::Constant(100), Vector3::Constant(10), 1, 10};
  parameters.topic = "spring";
  CartesianImpedance law(parameters);
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  const auto force_of = [&] {
    Vector7 tau;
    law.step(arm.cycle, reference, tau);
    return Vector7(tau - arm.model.coriolis());
  };
  reference.cartesian.position.x() += 0.02;
  const Vector7 soft = force_of();
  Vector6 K;
  K << 1000, 1000, 1000, 10, 10, 10;
  law.sensor_inputs()[0]->put(sample_of<6>(2, K));
  Vector7 before = soft;
  for (int i = 0; i < kRampCycles; ++i) {
    const Vector7 tau = force_of();
    EXPECT_LT((tau - before).norm(), 1.1 * 9 * soft.norm() / kRampCycles);
    before = tau;
  }
  EXPECT_LT((before - 10 * soft).norm(), 1e-3 * before.norm());
}

TEST_F(Streamed, MessagesAllocateNothing) {
  if (!allocations::kCounts) GTEST_SKIP() << "the heap belongs to a sanitizer";
  ForcePosition law(position());
  const auto input = law.sensor_inputs()[0];
  Reference reference = pose_reference(arm);
  law.start(arm.cycle, reference);
  const SensorSample sample = sample_of<32>(2, Eigen::Matrix<double, 32, 1>::Ones());
  Vector7 tau;
  const testing_tools::AllocationCounter allocations;
  for (int i = 0; i < 10; ++i) {
    input->put(sample);
    law.step(arm.cycle, reference, tau);
  }
  EXPECT_EQ(allocations.count(), 0);
}

class StreamedForce : public testing::Test {
 protected:
  StreamForcePosition stream{{"force", 0.0, 0, 0.3}, models::limits(models::arm("fr3"), 10)};
  std::shared_ptr<SensorInput> input = stream.sensor_inputs()[0];
  Reference reference;

  SensorSample message(const Eigen::Isometry3d& pose, const Vector6& wrench) const {
    Eigen::Matrix<double, 22, 1> values;
    values << pose.matrix().reshaped(), wrench;
    return sample_of<22>(3, values);
  }
  void SetUp() override {
    reference.motion = Channels::kPose;
    reference.cartesian.position = {0.4, 0, 0.5};
    stream.start(reference);
  }
};

TEST_F(StreamedForce, GoesToThePoseAndTheWrenchThatAreSent) {
  EXPECT_EQ(stream.fills(), Channels::kPose | Channels::kWrench);
  Eigen::Isometry3d pose(Eigen::AngleAxisd(0.4, Vector3(1, 2, 3).normalized()));
  pose.translation() = Vector3(0.45, 0.1, 0.45);
  const Vector6 wrench = (Vector6() << 1, 2, -20, 0.5, 0, -1).finished();
  ASSERT_EQ(input->check(message(pose, wrench)), "");
  input->put(message(pose, wrench));
  Vector6 before = Vector6::Zero();
  for (int i = 0; i < 5000; ++i) {
    EXPECT_FALSE(stream.step(at_home(), i * 0.001, reference));
    EXPECT_LT((reference.wrench - before).norm(), 1.01 * wrench.norm() / 50);
    before = reference.wrench;
  }
  EXPECT_LT((reference.wrench - wrench).norm(), 1e-9);
  EXPECT_LT((reference.cartesian.position - pose.translation()).norm(), 1e-6);
  EXPECT_LT(reference.cartesian.orientation.angularDistance(Eigen::Quaterniond(pose.linear())), 1e-6);
}

TEST_F(StreamedForce, WhatIsNoPoseIsRefused) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  EXPECT_EQ(input->check(message(pose, Vector6::Zero())), "");
  EXPECT_NE(input->check(message(pose, Vector6::Constant(60))).find("force[3] is 60"), std::string::npos);
  pose.matrix() *= 1.1;
  EXPECT_NE(input->check(message(pose, Vector6::Zero())), "");
  pose.matrix() = Eigen::Vector4d(1, 1, -1, 1).asDiagonal();  // a mirror
  EXPECT_NE(input->check(message(pose, Vector6::Zero())), "");
  pose.matrix() = Eigen::Matrix4d::Identity();
  pose.matrix()(3, 0) = 0.4;  // by rows
  EXPECT_NE(input->check(message(pose, Vector6::Zero())), "");
}

}  // namespace
}  // namespace realtime
