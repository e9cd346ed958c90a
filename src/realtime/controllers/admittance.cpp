#include "realtime/controllers/admittance.hpp"

#include <algorithm>

#include "realtime/check.hpp"
#include "realtime/controllers/felt_wrench.hpp"
#include "realtime/rotation.hpp"

namespace realtime {
namespace {

constexpr double kNullspaceStiffness = 10;  // N m/rad
constexpr double kAhead = 0.05, kTurnedAhead = 0.2;  // m, rad

}  // namespace

Admittance::Admittance(const Parameters& parameters)
    : parameters_(parameters),
      follower_({Vector3::Constant(parameters.translational_tracking), Vector3::Constant(parameters.rotational_tracking), 1,
                 kNullspaceStiffness}) {
  for (int i = 0; i < 6; ++i) {
    const bool linear = i < 3;
    require_within("mass", i, parameters.mass[i], linear ? 0.5 : 0.01, linear ? 100 : 10, linear ? "kg" : "kg m^2");
    require_within("damping", i, parameters.damping[i], 0, linear ? 2000 : 200, linear ? "N s/m" : "N m s/rad");
    require_within("stiffness", i, parameters.stiffness[i], 0, linear ? 3000 : 300, linear ? "N/m" : "N m/rad");
  }
  require_within("translational_tracking", -1, parameters.translational_tracking, 100, 3000, "N/m");
  require_within("rotational_tracking", -1, parameters.rotational_tracking, 10, 300, "N m/rad");
}

void Admittance::start(const Cycle& cycle, Reference& reference) noexcept {
  stay();
  follower_.start(cycle, reference);
}

void Admittance::stay() noexcept {
  position_.setZero();
  orientation_.setIdentity();
  velocity_.setZero();
}

// As far from where the arm is led to as it has followed there, and a little: what is in the way of the arm is in that of x, which would
// have to come back first. Where the arm is: from the reference.
void Admittance::stay_near(const Vector3& position, const Eigen::Quaterniond& orientation) noexcept {
  const auto within = [](const Vector3& way, double most) { return Vector3(most / std::max(way.norm(), most) * way); };
  position_ = position + within(position_ - position, kAhead);
  orientation_ = (exp(within(log(orientation_ * orientation.conjugate()), kTurnedAhead)) * orientation).normalized();
}

void Admittance::step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept {
  const Parameters& p = parameters_;
  const double dt = cycle.dt;
  Vector6 x;
  x << position_, log(orientation_);
  // Backward in time: stable with any values.
  const Vector6 before = velocity_;
  const Vector6 push = -felt_wrench(cycle) - p.stiffness.cwiseProduct(x);
  velocity_ = (p.mass.cwiseProduct(before) + dt * push)
                  .cwiseQuotient(p.mass + dt * p.damping + dt * dt * p.stiffness);
  position_ += dt * velocity_.head<3>();
  orientation_ = (exp(dt * velocity_.tail<3>()) * orientation_).normalized();
  const CartesianReference& pose = reference.cartesian;
  const Eigen::Quaterniond turned = Eigen::Quaterniond(cycle.O_T_EE.linear()) * pose.orientation.conjugate();
  stay_near(cycle.O_T_EE.translation() - pose.position, turned);

  Reference moved = reference;
  // x turns what the reference does as well.
  const Vector3 turning = orientation_ * pose.velocity.tail<3>();
  const Vector3 turning_faster = orientation_ * pose.acceleration.tail<3>() + velocity_.tail<3>().cross(turning);
  moved.cartesian.velocity.tail<3>() = turning;
  moved.cartesian.acceleration.tail<3>() = turning_faster;
  moved.cartesian.position += position_;
  moved.cartesian.orientation = orientation_ * pose.orientation;
  moved.cartesian.velocity += velocity_;
  moved.cartesian.acceleration += (velocity_ - before) / dt;
  follower_.step(cycle, moved, tau_J_d);
}

}  // namespace realtime
