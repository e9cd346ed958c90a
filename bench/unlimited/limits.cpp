// Takes the place of src/realtime/limiter.cpp, joint_barrier.cpp and falling_torque.cpp in a server that limits nothing: what bench/switches.py
// has to find then. Each of their functions, so that the linker takes none from the library.

#include <limits>

#include "realtime/falling_torque.hpp"
#include "realtime/joint_barrier.hpp"
#include "realtime/limiter.hpp"

namespace realtime {

struct Limiter::Impl {
  Reference last;
};

Limiter::Limiter(const models::Limits&) : impl_(std::make_unique<Impl>()) {}
Limiter::~Limiter() = default;

void Limiter::reduce(const models::Limits&) noexcept {}
void Limiter::bound(const Vector7&) noexcept {}
void Limiter::spare(double, double) noexcept {}
bool Limiter::reset(const Reference& from) noexcept { return impl_->last = from, false; }
void Limiter::joints_follow(const JointsOfPose&, const JointsOfPose&, bool) noexcept {}
bool Limiter::has_room() noexcept { return true; }
Vector7 Limiter::joints_ahead(const Vector7& q) const noexcept { return q; }

bool Limiter::follow(const Reference& wanted, double, Reference& out) noexcept {
  if (wanted.motion == impl_->last.motion) impl_->last = wanted;
  out = impl_->last;
  return false;
}

void Limiter::take_back() noexcept {}
std::size_t Limiter::way_to_rest(std::span<Vector7> joints, bool) noexcept { return joints[0] = impl_->last.joint.q, 1; }
std::size_t Limiter::way_to_rest(std::span<Vector6> pose) const noexcept { return pose[0].setZero(), 1; }

bool Limiter::brake(double, Reference& out, bool) noexcept {
  out = impl_->last = realtime::at_rest(impl_->last);
  return true;
}

void Limiter::coast(double, Reference& out) noexcept { out = impl_->last; }
bool Limiter::reconcile(const Reference&, int, double, double, Reference&) noexcept { return false; }
const Reference& Limiter::last() const noexcept { return impl_->last; }
Vector7 Limiter::joint_velocity_to_come() const noexcept { return impl_->last.joint.dq; }
bool Limiter::stuck() const noexcept { return false; }

bool Limiter::at_rest() const noexcept {
  const Reference& last = impl_->last;
  return last.motion == Channels::kJoint ? last.joint.dq.isZero(1e-6) : last.cartesian.velocity.isZero(1e-6);
}

TorqueLimiter::TorqueLimiter(const models::Limits& limits) : tau_max_(Vector7::Map(limits.tau_max.data())) {}
void TorqueLimiter::beside(const Vector7&) noexcept {}
double TorqueLimiter::share_inside(const Vector7&, const Vector7&) const noexcept { return 1; }
bool TorqueLimiter::scale(const Vector7& wanted, const Vector7&, double, Vector7& out) const noexcept {
  out = wanted;
  return false;
}
bool TorqueLimiter::limit(const Vector7& wanted, const Vector7&, double, Vector7& out) const noexcept {
  out = wanted;
  return false;
}

JointBarrier::JointBarrier(const models::Limits& limits)
    : limits_(limits),
      asked_(limits.dq_max),
      dq_min_(Vector7::Constant(-std::numeric_limits<double>::infinity())),
      dq_max_(Vector7::Constant(std::numeric_limits<double>::infinity())) {}
bool JointBarrier::add(const Vector7&, const Vector7&, const Matrix7&, const Vector7&, const Lead&, Vector7&, Brake*) noexcept {
  return false;
}

FallingTorque::FallingTorque(const Model& model, const Vector7& dq, const Matrix7& mobility, const Vector7& rest,
                             const Vector7& gravity, const Vector7& rate, const Vector7& sent, const WallGuard& walls) noexcept
    : model_(model), mobility_(mobility), rest_(rest), gravity_(gravity), rate_(rate), sent_(sent), walls_(walls), dq_(dq) {}
bool FallingTorque::keeps(const SpeedBounds&, const Vector7&) const noexcept { return true; }
void FallingTorque::hold(const SpeedBounds&, const Vector7&, Vector7&) const noexcept {}

}  // namespace realtime
