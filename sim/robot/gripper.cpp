#include "sim/robot/gripper.hpp"

#include <algorithm>
#include <cmath>

#include "models/arm.hpp"
#include "sim/robot/dt.hpp"

namespace sim {
namespace {

using models::hand::kMaxForce;
using models::hand::kMaxSpeed;
using models::hand::kMaxWidth;

// Data sheet of the hand: beside the force that it can exert for ever.
constexpr double kPeakForce = 140;  // N

// What Franka does not publish: a drive as stiff as a screw or rack is, at its limits of what 1 kHz can hold.
constexpr double kStiffness = 8000;       // N/m, of each finger
constexpr double kFingerDamping = 55;     // N s/m
constexpr double kHomingSpeed = 0.05;     // m/s, of the width
constexpr double kHomingForce = 20;       // N
constexpr double kStillVelocity = 0.001;  // m/s of each finger
constexpr int kStill = 60;                // cycles after which fingers that do not move have arrived
constexpr double kArrived = 0.001;        // m of width
// The drive warms up with the square of its force. More than the continuous force it exerts while it is cooler than that
// one would make it.
constexpr double kTemperature = 30;   // °C, at rest
constexpr double kWarming = 25;       // K, at the continuous force for ever
constexpr double kWarmingTime = 900;  // s

}  // namespace

Gripper::Gripper(const std::array<double, 2>& finger)
    : goal_((finger[0] + finger[1]) / 2), reference_(goal_), force_(kMaxForce), temperature_(kTemperature), before_(finger) {
  state_.width = std::max(0.0, 2 * goal_);
  state_.temperature = static_cast<std::uint16_t>(std::lround(kTemperature));
}

void Gripper::home() { begin(Task::kHome, kMaxWidth + 2 * kHomingForce / kStiffness, kHomingSpeed, kHomingForce); }

void Gripper::move(const fci::gripper::Move& request) {
  if (!(request.width >= 0 && request.width <= kMaxWidth + kArrived) || !(request.speed > 0)) return refuse();
  begin(Task::kMove, request.width, request.speed, kMaxForce);
}

void Gripper::grasp(const fci::gripper::Grasp& request) {
  if (!(request.width >= 0 && request.width <= kMaxWidth + kArrived) || !(request.speed > 0) ||
      !(request.force > 0 && request.force <= kPeakForce) || !(request.epsilon_inner >= 0) || !(request.epsilon_outer >= 0)) {
    return refuse();
  }
  grasp_ = request;
  // Fingers that are narrower than the object take hold of it from inside. The goal lies so far beyond what stops
  // them that the force is reached there.
  const double beyond = 2 * request.force / kStiffness;
  const bool close = request.width - request.epsilon_inner <= state_.width;
  begin(Task::kGrasp, close ? -beyond : kMaxWidth + beyond, request.speed, request.force);
}

void Gripper::stop() {
  goal_ = reference_ = state_.width / 2;
  gripping_ = state_.is_grasped = false;
  task_ = Task::kHold;
}

void Gripper::begin(Task task, double width, double speed, double force) {
  task_ = task;
  outcome_.reset();
  gripping_ = false;
  goal_ = width / 2;
  speed_ = std::min(speed, kMaxSpeed) / 2;
  force_ = force;
  still_ = 0;
}

// What was under way has been aborted; what is held stays held.
void Gripper::refuse() {
  if (task_ != Task::kHold) stop();
  end(Status::kFail);
}

void Gripper::end(Status outcome) {
  task_ = Task::kHold;
  outcome_ = outcome;
}

std::array<double, 2> Gripper::control(const std::array<double, 2>& finger) {
  const std::array<double, 2> velocity = {(finger[0] - before_[0]) / kDt, (finger[1] - before_[1]) / kDt};
  before_ = finger;
  const double x = (finger[0] + finger[1]) / 2, v = (velocity[0] + velocity[1]) / 2;

  if (temperature_ >= kTemperature + kWarming) force_ = std::min(force_, kMaxForce);
  // The spring is never drawn further than for its greatest force.
  const double reach = force_ / kStiffness;
  if (reach < reach_) reference_ = std::clamp(reference_, x - reach, x + reach);  // without a kick
  reach_ = reach;
  const double from = reference_;
  reference_ = std::clamp(goal_, reference_ - kDt * speed_, reference_ + kDt * speed_);
  reference_ = std::clamp(reference_, x - reach, x + reach);
  const double force = std::clamp(
      kStiffness * (reference_ - x) + kFingerDamping * ((reference_ - from) / kDt - v), -force_, force_);

  const double load = force / kMaxForce;
  temperature_ += kDt / kWarmingTime * (kTemperature + kWarming * load * load - temperature_);
  state_.temperature = static_cast<std::uint16_t>(std::lround(temperature_));

  follow_up(x, v);
  state_.width = std::max(0.0, 2 * x);
  state_.is_grasped = gripping_ && state_.width >= grasp_.width - grasp_.epsilon_inner &&
                      state_.width <= grasp_.width + grasp_.epsilon_outer;
  // One drive moves both fingers.
  std::array<double, 2> forces;
  for (int i = 0; i < 2; ++i) forces[i] = force + kStiffness * (x - finger[i]) + kFingerDamping * (v - velocity[i]);
  return forces;
}

void Gripper::follow_up(double x, double v) {
  if (task_ == Task::kHold) return;
  // By what is in the way of where it goes, and not by what it has held until then.
  const bool drawn = std::abs(reference_ - x) >= 0.98 * force_ / kStiffness && (goal_ - x) * (reference_ - x) > 0;
  const bool there = std::abs(goal_ - reference_) < 1e-9;
  still_ = (drawn || there) && std::abs(v) < kStillVelocity ? still_ + 1 : 0;
  if (still_ < kStill) return;
  const double width = std::max(0.0, 2 * x);
  switch (task_) {
    case Task::kHold: break;
    case Task::kHome:
      state_.max_width = width;
      goal_ = reference_ = x;
      end(Status::kSuccess);
      break;
    case Task::kMove: {
      const bool arrived = std::abs(width - 2 * goal_) < kArrived;
      if (!arrived) goal_ = reference_ = x;
      end(arrived ? Status::kSuccess : Status::kUnsuccessful);
      break;
    }
    case Task::kGrasp:
      gripping_ = width >= grasp_.width - grasp_.epsilon_inner && width <= grasp_.width + grasp_.epsilon_outer;
      end(gripping_ ? Status::kSuccess : Status::kUnsuccessful);
      break;
  }
}

}  // namespace sim
