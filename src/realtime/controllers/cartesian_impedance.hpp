#pragma once

#include <optional>
#include <string>

#include "realtime/controllers/controller.hpp"
#include "realtime/controllers/gain_stream.hpp"

namespace realtime {

// Spring and damper between EE and its reference, with the arm's dynamics (Khatib, A unified approach for
// motion and force control of robot manipulators, IEEE J. Robotics and Automation 3(1), 1987, and for
// damping and null space Albu-Schäffer, Ott, Frese, Hirzinger, Cartesian impedance control of redundant
// robots, ICRA 2003):
//
//   tau_J_d = J^T (K e + i + D (v_ref - v) + Lambda (a_ref - dJ dq)) + coriolis + B ddq_ref + friction(dq_ref) + tau_null
//
// e is the way to the reference: position along the axes of O, and the rotation vector in O of the shortest
// rotation to it, right up to 180°. Lambda = (J M^-1 J^T)^-1. D is designed with it, so that each mode of
// Lambda, D, K has the damping ratio (less where the delay of the loop does not allow it). tau_null holds
// the motion of the elbow that leaves EE at rest to the joints that the reference means (Cycle::q_ref), critically damped, and
// does not accelerate EE; at the start to where the torque goes on as it was, and from there to these. So the elbow does not
// creep over a sequence of skills. Next to a singularity, where e has little power over them, tau_null also holds the joints in
// what hardly moves EE, or they would swing past it and come back another way. The modes change slowly and are found anew every
// few cycles. Lambda counts the links alone, as damping has to be safe with whatever the motors add: their inertia B makes the arm
// less damped than asked. It is met ahead with the reference's acceleration, and friction with its velocity (Cycle::dq_ref): who
// pushes the arm feels none of it. A topic sets the stiffness anew while it runs (CartesianImpedanceSensorMessage).
//
// i is the sum of r K e dt along and about each axis of the stiffness, bounded: it takes away what friction and a load that the
// robot does not know leave of e. With it a mode of damping d, x'' + d x' + w² x + r w² (the sum of x dt) = 0, is stable if and
// only if r < d (Routh): r is at most a quarter of the least damped mode's d, its motors counted. i does not grow while another
// torque leaves than this law asks for (limits, walls, what fades at a start), and begins with what the torque before exerts
// beyond K e, as far as that goes. The posture that a skill may ask for is its reference's (PoseJoints): so the gate knows where
// the elbow is led.
class CartesianImpedance : public Controller {
 public:
  enum class Frame { kBase, kEndEffector };

  struct Parameters {
    Vector3 translational_stiffness;  // N/m, 0 to 3000, along the axes of the frame
    Vector3 rotational_stiffness;     // N m/rad, 0 to 300, about the axes of the frame
    double damping_ratio;             // 0.1 to 3
    double nullspace_stiffness;       // N m/rad, 0 to 100
    Frame frame = Frame::kBase;       // EE: its measured axes, turning with it
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // columns, in that frame: what stiffness is along and about
    std::optional<std::string> topic = {};
    double integral_rate = 0;                  // r, 1/s, 0 to 10
    Vector6 integral_limit = Vector6::Zero();  // of i: N, 0 to 100; N m, 0 to 20
    std::optional<Vector7> posture = {};       // rad, that the null space is led near; none: where it is
  };

  // Throws std::invalid_argument naming field, value and bound.
  explicit CartesianImpedance(const Parameters& parameters);

  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return stiffness_.inputs(); }
  Channels takes() const noexcept override { return Channels::kPose; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }
  std::optional<Vector7> posture() const noexcept override { return posture_; }
  Vector6 led_pose(const Cycle& cycle, const Vector6& way) const noexcept override {
    return in_base(cycle, (stiffness_.now().array() > 0).select(in_frame(cycle, way), 0));
  }

  // Moves the reference pose where there is stiffness, as far as the integral does not do, and the posture for the null space.
  void start(const Cycle& cycle, Reference& reference) noexcept override;
  void stay() noexcept override { integral_.setZero(); }
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override;

  // Between the axes of O and those of the stiffness.
  Vector6 in_frame(const Cycle& cycle, const Vector6& v) const noexcept;
  Vector6 in_base(const Cycle& cycle, const Vector6& v) const noexcept;

 private:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  struct Dynamics;

  void find_modes(const Cycle& cycle, const Dynamics& arm) noexcept;
  void find_least_damping(const Dynamics& arm) noexcept;
  Vector6 damping_force(const Dynamics& arm, const Vector6& velocity_error) const noexcept;
  Vector6 other_force(const Cycle& cycle, const Dynamics& arm, const CartesianReference& reference) const noexcept;

  Vector7 ahead(const Cycle& cycle, const Dynamics& arm, const CartesianReference& reference) const noexcept;
  Vector7 along(const Cycle& cycle, const Vector7& way) const noexcept;
  void integrate(const Cycle& cycle, const Vector6& spring) noexcept;

  GainStream<6> stiffness_;
  Frame frame_;
  Eigen::Matrix3d axes_;
  double damping_ratio_, nullspace_stiffness_, integral_rate_;
  Vector6 integral_limit_;
  std::optional<Vector7> posture_;
  Matrix6 modes_;         // as columns, in coordinates in which Lambda is the identity
  Vector6 mode_damping_;  // 1/s
  double least_damping_ = 0;  // 1/s, of the modes that have stiffness, with their motors
  int modes_age_ = 0;     // cycles
  int null_column_ = 2;   // joint
  Vector7 posture_shift_ = Vector7::Zero();  // rad, of what the null space is held to; fades
  Vector6 integral_ = Vector6::Zero();       // N, N m, in the axes of the stiffness
  Vector7 asked_ = Vector7::Zero();          // N m, in the cycle before
};

}  // namespace realtime
