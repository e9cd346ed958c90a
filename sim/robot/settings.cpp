#include "sim/robot/settings.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <limits>
#include <span>

#include "sim/robot/franka_hand.hpp"
#include "sim/robot/transform.hpp"
#include "sim/robot/vectors.hpp"

namespace sim {
namespace {

// The thresholds after power-on are not published. Franka's own franka_control starts with 20 N m and 20 N for all,
// contact and collision alike; libfranka's examples have the same while accelerating, and half of it else.
constexpr double kThreshold = 20;

// What a load or a frame may be at most is not published either: here more than any arm has, and what the configuration
// of the server lets through. Of a number that is only finite, what the model computes may be none.
constexpr double kHeaviest = 20;      // kg
constexpr double kMostInertia = 100;  // kg m²
constexpr double kFarthest = 2;       // m, along each axis

template <class Values>
bool within(const Values& values, double low, double high) {
  return std::all_of(values.begin(), values.end(), [&](double x) { return x >= low && x <= high; });
}

bool is_frame(const fci::Pose& pose) {
  return is_transform(pose) && within(std::span(pose).subspan(12, 3), -kFarthest, kFarthest);
}

}  // namespace

Settings::Settings()
    // Gains: those to which Franka's staff point, setDefaultBehavior of libfranka's examples.
    : joint_impedance{{3000, 3000, 3000, 2500, 2500, 2000, 2000}},
      cartesian_impedance{{3000, 3000, 3000, 300, 300, 300}},
      guiding{{true, true, true, true, true, true}, true},
      end_effector(franka_hand()),
      F_T_NE(F_T_hand_TCP()) {
  collision.lower_torque_thresholds_acceleration.fill(kThreshold);
  collision.upper_torque_thresholds_acceleration.fill(kThreshold);
  collision.lower_torque_thresholds_nominal.fill(kThreshold);
  collision.upper_torque_thresholds_nominal.fill(kThreshold);
  collision.lower_force_thresholds_acceleration.fill(kThreshold);
  collision.upper_force_thresholds_acceleration.fill(kThreshold);
  collision.lower_force_thresholds_nominal.fill(kThreshold);
  collision.upper_force_thresholds_nominal.fill(kThreshold);
}

Eigen::Matrix4d Settings::F_T_EE() const { return F_T_NE * matrix(NE_T_EE); }

bool Settings::valid(const fci::SetCollisionBehavior& request) {
  constexpr double kInfinity = std::numeric_limits<double>::max();
  return within(request.lower_torque_thresholds_acceleration, 0, kInfinity) &&
         within(request.upper_torque_thresholds_acceleration, 0, kInfinity) &&
         within(request.lower_torque_thresholds_nominal, 0, kInfinity) &&
         within(request.upper_torque_thresholds_nominal, 0, kInfinity) &&
         within(request.lower_force_thresholds_acceleration, 0, kInfinity) &&
         within(request.upper_force_thresholds_acceleration, 0, kInfinity) &&
         within(request.lower_force_thresholds_nominal, 0, kInfinity) &&
         within(request.upper_force_thresholds_nominal, 0, kInfinity);
}

bool Settings::valid(const fci::SetJointImpedance& request) { return within(request.K_theta, 0, 14250); }

bool Settings::valid(const fci::SetCartesianImpedance& request) {
  const std::span K_x(request.K_x);
  return within(K_x.first(3), 10, 3000) && within(K_x.last(3), 1, 300);
}

bool Settings::valid(const fci::SetEEToK& request) { return is_frame(request.EE_T_K); }

bool Settings::valid(const fci::SetNEToEE& request) { return is_frame(request.NE_T_EE); }

bool Settings::valid(const fci::SetLoad& request) {
  constexpr double kTolerance = 1e-9;  // kg m²
  const Eigen::Map<const Eigen::Matrix3d> I(request.I_load.data());
  return request.m_load >= 0 && request.m_load <= kHeaviest && within(request.F_x_Cload, -kFarthest, kFarthest) &&
         within(request.I_load, -kMostInertia, kMostInertia) &&
         (I - I.transpose()).cwiseAbs().maxCoeff() <= kTolerance &&
         Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(I, Eigen::EigenvaluesOnly).eigenvalues().minCoeff() >=
             -kTolerance;
}

bool Settings::valid(const fci::SetFilters& request) {
  for (double frequency : {request.joint_position_filter_frequency, request.joint_velocity_filter_frequency,
                           request.cartesian_position_filter_frequency, request.cartesian_velocity_filter_frequency,
                           request.controller_filter_frequency}) {
    if (!(frequency > 0 && frequency <= kNoFilter)) return false;
  }
  return true;
}

void Settings::take(const fci::SetLoad& request) {
  load = {request.m_load, vector(request.F_x_Cload), Eigen::Map<const Eigen::Matrix3d>(request.I_load.data())};
}

}  // namespace sim
