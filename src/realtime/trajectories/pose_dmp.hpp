#pragma once

#include "models/arm.hpp"
#include "realtime/trajectories/dmp_sensors.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace realtime {

// A movement primitive (dmp.hpp) of the position of EE in O and of its intrinsic XYZ Euler angles, R = Rx(a) Ry(b)
// Rz(c) with b within ±90° at the start. Begins, ends and is made slower as JointDmp, for the Cartesian limits. Where b
// is within 3° of ±90° an angular velocity at the start is not taken up.
class PoseDmp : public TrajectoryGenerator {
 public:
  enum class Dimensions { kAll, kPosition, kOrientation };  // the others stay

  struct Parameters {
    DmpSpring spring;
    DmpForce force;   // m, rad; sensor values are of each dimension
    double duration;  // s, 0.001 to 120
    Dimensions dimensions = Dimensions::kAll;
    bool ee_frame = false;  // the translation is along the axes of EE at the start; else of O
  };

  // `first`: kMinJerk, or kGoal for the formulation with a goal that pulls from the beginning. Throws
  // std::invalid_argument naming field, value and bound.
  PoseDmp(FirstBasis first, const Parameters& parameters, const models::Limits& limits);

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return rollout_.inputs(); }
  Channels fills() const noexcept override { return Channels::kPose; }
  void start(const Reference& from) noexcept override;
  bool step(const Cycle&, double time, Reference& reference) noexcept override;
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override { return motion_.duration(); }
  double stretch() const noexcept override { return slower_; }

 private:
  // Position and orientation of y.
  void place(const Vector6& y, CartesianReference& pose) const noexcept;

  models::Limits limits_;
  bool ee_frame_;
  DmpSensors<6> rollout_;
  double slower_ = 1;
  DmpMotion<6, DmpSensors<6>> motion_;  // way along the axes of `axes_`, and Euler angles
  Vector3 from_ = Vector3::Zero();
  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();
  Reference goal_;
};

}  // namespace realtime
