#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>

namespace realtime {

using Vector3 = Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix67 = Eigen::Matrix<double, 6, 7>;
using Matrix76 = Eigen::Matrix<double, 7, 6>;

// What a reference says: a motion of the joints or of EE, and beside it what the arm is to exert. Also sets of these.
enum class Channels : std::uint8_t {
  kNone = 0,
  kJoint = 1,   // Reference::joint
  kPose = 2,    // Reference::cartesian
  kWrench = 4,  // Reference::wrench
  kTorque = 8,  // Reference::torque
};

constexpr Channels operator|(Channels a, Channels b) { return static_cast<Channels>(static_cast<int>(a) | static_cast<int>(b)); }
constexpr Channels operator&(Channels a, Channels b) { return static_cast<Channels>(static_cast<int>(a) & static_cast<int>(b)); }

// Whether each of `some` is among `all`.
constexpr bool has(Channels all, Channels some) { return (all & some) == some; }

// The one that says a motion.
constexpr Channels motion_of(Channels channels) { return channels & (Channels::kJoint | Channels::kPose); }

struct JointReference {
  Vector7 q = Vector7::Zero();    // rad
  Vector7 dq = Vector7::Zero();   // rad/s
  Vector7 ddq = Vector7::Zero();  // rad/s²
};

// Of the end-effector frame EE in the base frame O; linear before angular.
struct CartesianReference {
  Vector3 position = Vector3::Zero();                                    // m
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  Vector6 velocity = Vector6::Zero();                                    // m/s, rad/s
  Vector6 acceleration = Vector6::Zero();                                // m/s², rad/s²
};

// Joints that go where a pose leads them, the elbow (joint 3) staying where it is.
struct JointsOfPose {
  Vector7 q = Vector7::Zero();              // rad
  Matrix76 dq_dP = Matrix76::Zero();  // dq = dq_dP O_dP_EE
  Eigen::Isometry3d O_T_EE = Eigen::Isometry3d::Identity();  // at q
  double determinant = 0;  // of the Jacobian of the joints that go along, undamped; 0.037 at home
  Vector7 null_motion = Vector7::Zero();  // that leaves EE at rest while the elbow moves by 1
};

// What a trajectory generator emits each cycle. Of joint and cartesian only the one that `motion` names means something.
struct Reference {
  Channels motion = Channels::kJoint;
  JointReference joint;
  CartesianReference cartesian;
  Vector6 wrench = Vector6::Zero();  // that EE exerts on what it touches, at EE in the axes of O; N, N m
  Vector7 torque = Vector7::Zero();  // of the joints, beside gravity; N m
};

inline bool is_finite(const Reference& reference) {
  if (!reference.wrench.allFinite() || !reference.torque.allFinite()) return false;
  if (reference.motion == Channels::kJoint) {
    const JointReference& joint = reference.joint;
    return joint.q.allFinite() && joint.dq.allFinite() && joint.ddq.allFinite();
  }
  const CartesianReference& pose = reference.cartesian;
  return pose.position.allFinite() && pose.orientation.coeffs().allFinite() && pose.velocity.allFinite() &&
         pose.acceleration.allFinite();
}

// The same place, without velocity, acceleration and effort.
inline Reference at_rest(Reference reference) {
  reference.wrench.setZero();
  reference.torque.setZero();
  reference.joint.dq.setZero();
  reference.joint.ddq.setZero();
  reference.cartesian.velocity.setZero();
  reference.cartesian.acceleration.setZero();
  return reference;
}

}  // namespace realtime
