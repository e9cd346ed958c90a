#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "models/arm.hpp"
#include "sim/world/world.hpp"

namespace sim {

// What the arm's sensors say of what is so. Figures of their noise: joint_figures.hpp.
class Sensors {
 public:
  using Vector = Eigen::Matrix<double, 7, 1>;

  // The same seed gives the same noise; ideal sensors have none, and sit on stiff joints.
  Sensors(const models::Arm& arm, bool ideal, std::uint64_t seed);

  // One cycle.
  void read(const Truth& truth);

  Vector q, dq, ddq, tau_J;  // rad, rad/s, rad/s² (differences of dq), N m at the links
  Vector dtau_J;             // N m/s, low-passed
  Vector theta, dtheta;      // rad, rad/s: of the motors, behind the joints' springs
  // m/s²: what six links feel, weight included, in their axes; at the joint before and at the joint behind.
  std::array<double, 18> accelerometer_bottom, accelerometer_top;

 private:
  double noise(double sigma);
  void accelerate();

  std::array<Eigen::Matrix3d, 6> frame_R_;  // of joint i in the frame before it, at q = 0
  std::array<Eigen::Vector3d, 7> frame_p_;
  bool ideal_;
  bool seen_ = false;
  std::uint64_t random_;
};

}  // namespace sim
