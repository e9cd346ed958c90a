#pragma once

#include <Eigen/Geometry>

#include "models/arm.hpp"
#include "realtime/trajectories/dmp_sensors.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// The position of EE in O as with PoseDmp, and a movement primitive of its orientation that ends at a goal, in the
// rotation vector r in O of R = exp(r) R_goal (Koutras, Doulgeri, A correct formulation for the Orientation Dynamic
// Movement Primitives for robot control in the Cartesian space, CoRL 2019):
//
//   T² r'' = alpha (-beta r - T r') + f(x),  x = exp(-t/T),  f = 0 after T
//
// with basis functions kGaussian. Where r keeps its direction this is the spring of unit quaternions of Ude, Nemec,
// Petrič, Morimoto, Orientation in Cartesian space dynamic movement primitives, ICRA 2014. It begins, ends and is made
// slower as PoseDmp, as a whole; jerk of the rotation is left to the limiter.
class QuaternionPoseDmp : public TrajectoryGenerator {
 public:
  struct Parameters {
    DmpSpring position_spring;
    DmpForce position_force;  // m; sensor values are of each dimension
    double alpha, beta;       // of the orientation
    DmpForce force;           // rad; all sensor values are 1
    Eigen::Quaterniond goal;  // in O
    double goal_time;         // T, s, > 0
    double duration;          // s, 0.001 to 120
    bool ee_frame = false;    // the translation is along the axes of EE at the start; else of O
  };

  // Throws std::invalid_argument naming field, value and bound.
  QuaternionPoseDmp(const Parameters& parameters, const models::Limits& limits);

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return translation_rollout_.inputs(); }
  Channels fills() const noexcept override { return Channels::kPose; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return translation_.duration(); }
  double stretch() const noexcept override { return slower_; }

 private:
  models::Limits limits_;
  bool ee_frame_;
  Eigen::Quaterniond goal_orientation_;
  DmpSensors<3> translation_rollout_;
  DmpRollout<3> rotation_rollout_;
  double translation_slower_ = 1, slower_ = 1;
  DmpMotion<3, DmpSensors<3>> translation_;
  DmpMotion<3> rotation_;
  Vector3 from_ = Vector3::Zero();
  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();
  Reference goal_;
};

}  // namespace realtime
