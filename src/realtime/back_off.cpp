#include "realtime/back_off.hpp"

namespace realtime {
namespace {

constexpr double kHardly = 1e-3;  // m/s
constexpr double kNoForce = 0.1;  // N
constexpr double kMostTurn = 0.5;  // rad, of joints that go as they came: of a hand that merely turned it would be any number

}  // namespace

void BackOff::plan(const SoftEnding& ending, const Reference& reference, const Vector3& pushes, const Vector7& q,
                   Model& model) noexcept {
  const bool joints = reference.motion == Channels::kJoint;
  const Vector3 v = joints ? Vector3(model.jacobian().topRows<3>() * reference.joint.dq)
                           : Vector3(reference.cartesian.velocity.head<3>());
  const bool turned = joints && ending.distance * reference.joint.dq.norm() > kMostTurn * v.norm();
  const bool came = v.norm() > kHardly && !turned;
  if (!came && pushes.norm() < kNoForce) return;  // nothing says where to
  way_ = ending.distance * (came ? Vector3(-v.normalized()) : Vector3(pushes.normalized()));
  if (joints && came) {
    joints_ = -ending.distance / v.norm() * reference.joint.dq;
  } else if (joints) {
    joints_ = model.joints_of_pose(q).dq_dP.leftCols<3>() * way_;
  }
  using Scalar = MinJerk<1>::Vector;
  share_.start(Scalar::Zero(), Scalar::Zero(), Scalar::Zero(), Scalar::Ones(), 0);
  share_.set_duration(1.875 * ending.distance / ending.speed);
  active_ = true;
  begun_ = false;
}

bool BackOff::step(const Reference& reference, Reference& wanted) noexcept {
  if (!begun_) {
    from_ = at_rest(reference);
    time_ = 0;
  }
  begun_ = true;
  time_ += kTick;
  const auto share = share_.at(time_);
  wanted = from_;
  if (wanted.motion == Channels::kJoint) {
    wanted.joint = {from_.joint.q + share.x[0] * joints_, share.v[0] * joints_, share.a[0] * joints_};
  } else {
    wanted.cartesian.position += share.x[0] * way_;
    wanted.cartesian.velocity.head<3>() = share.v[0] * way_;
    wanted.cartesian.acceleration.head<3>() = share.a[0] * way_;
  }
  return time_ >= share_.duration();
}

}  // namespace realtime
