#include "sim/robot/sensors.hpp"

#include <Eigen/Geometry>

#include "sim/robot/dt.hpp"
#include "sim/robot/joint_figures.hpp"
#include "sim/robot/low_pass.hpp"
#include "sim/robot/rotation.hpp"
#include "sim/robot/vectors.hpp"

namespace sim {
namespace {

constexpr double kTorqueRateFilter = 100;  // Hz, of dtau_J; not published
constexpr double kGravity = 9.81;          // m/s²

}  // namespace

Sensors::Sensors(const models::Arm& arm, bool ideal, std::uint64_t seed) : ideal_(ideal), random_(seed) {
  for (int i = 0; i < 7; ++i) {
    const auto& [xyz, rpy] = arm.joints[i];
    frame_p_[i] = Eigen::Vector3d(xyz.data());
    if (i == 6) break;
    frame_R_[i] = rotation_of_rpy(rpy);
  }
}

// Four uniform numbers of 16 bits make nearly a normal one, and never an outlier. Generator: Steele, Lea, Flood, Fast
// splittable pseudorandom number generators, OOPSLA 2014.
double Sensors::noise(double sigma) {
  std::uint64_t z = random_ += 0x9e3779b97f4a7c15;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
  z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
  z ^= z >> 31;
  const auto sum = (z & 0xffff) + ((z >> 16) & 0xffff) + ((z >> 32) & 0xffff) + (z >> 48);
  constexpr double kMean = 2 * 65535.0;
  constexpr double kDeviation = 65536 * 0.57735026918962576;  // of four uniform numbers, each 1/sqrt(12) wide
  return sigma * (static_cast<double>(sum) - kMean) / kDeviation;
}

void Sensors::read(const Truth& truth) {
  const Vector dq_before = dq, tau_J_before = tau_J;
  q = vector(truth.q);
  dq = vector(truth.dq);
  tau_J = vector(truth.tau_J);
  const double give = ideal_ ? 0 : 1 / kJointStiffness;
  if (!ideal_) {
    for (int i = 0; i < 7; ++i) {
      q[i] += noise(kPositionNoise);
      dq[i] += noise(kVelocityNoise);
      tau_J[i] += noise(kTorqueNoise);
    }
  }
  if (seen_) {
    ddq = (dq - dq_before) / kDt;
    static const double gain = low_pass_gain(kTorqueRateFilter);
    dtau_J += gain * ((tau_J - tau_J_before) / kDt - dtau_J);
  } else {
    ddq.setZero();
    dtau_J.setZero();
    seen_ = true;
  }
  theta = q + give * tau_J;
  dtheta = dq + give * dtau_J;
  accelerate();
}

// Outwards from the base, in the axes of each link: angular velocity, angular acceleration, felt acceleration.
void Sensors::accelerate() {
  Eigen::Vector3d w = Eigen::Vector3d::Zero(), dw = Eigen::Vector3d::Zero(), a(0, 0, kGravity);
  for (int i = 0; i < 6; ++i) {
    const double c = std::cos(q[i]), s = std::sin(q[i]);
    const auto into_link = [&](const Eigen::Vector3d& v) {
      const Eigen::Vector3d u = frame_R_[i].transpose() * v;
      return Eigen::Vector3d(c * u.x() + s * u.y(), c * u.y() - s * u.x(), u.z());
    };
    a = into_link(a + dw.cross(frame_p_[i]) + w.cross(w.cross(frame_p_[i])));
    w = into_link(w);
    dw = into_link(dw) + w.cross(dq[i] * Eigen::Vector3d::UnitZ()) + ddq[i] * Eigen::Vector3d::UnitZ();
    w.z() += dq[i];
    const Eigen::Vector3d& next = frame_p_[i + 1];
    Eigen::Map<Eigen::Vector3d>(accelerometer_bottom.data() + 3 * i) = a;
    Eigen::Map<Eigen::Vector3d>(accelerometer_top.data() + 3 * i) = a + dw.cross(next) + w.cross(w.cross(next));
  }
}

}  // namespace sim
