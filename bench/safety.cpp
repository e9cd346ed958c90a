// What virtual walls cost, with 20 boxes of which 5 are within 0.1 m of the arm.
//   safety_us_p50, _p99   of WallGuard and SelfGuard in a cycle: the way to rest, what leads past the walls or the arm itself where
//                         that is not clear, the way to rest again, and the torque; at random postures and speeds about home
//   safety_most_us_p50, _p99, _max
//                         of MotionGate and TorqueGate, all that they do, with all the walls and held bodies that there may be near
//                         the hand, while random motions of joints lead into these. The greatest is of a processor's time, and of
//                         the calmest of three passes over the same motions: what the machine takes it takes anywhere

#include <time.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "bench/boxes.hpp"
#include "bench/percentile.hpp"
#include "models/arm.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/model.hpp"
#include "realtime/motion_gate.hpp"
#include "realtime/torque_gate.hpp"
#include "realtime/walls/mesh.hpp"
#include "realtime/walls/self_guard.hpp"
#include "realtime/walls/wall_guard.hpp"

namespace {

using namespace realtime;

constexpr int kCycles = 50'000;
constexpr double kBrake = 5;  // rad/s²
constexpr int kGoal = 400;    // cycles, from one motion to the next
constexpr int kPasses = 3;

// m from the arm to a wall.
double gap(const ArmCapsules& arm, const ArmCapsules::Place& place, const Shape& shape) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < arm.all().size(); ++k) {
    least = std::min(least, nearest(shape, place.a[k], place.b[k]).distance - arm.all()[k].radius);
  }
  return least;
}

// As many walls as there may be about its hand, half of them meshes with all the triangles that there may be; and it
// holds as many bodies as it may.
std::unique_ptr<Walls> most_about(const models::Arm& arm) {
  auto out = std::make_unique<Walls>(Walls{ArmCapsules(arm, true), {}});
  for (int k = 0; k < ArmCapsules::kMostHeld; ++k) {
    const double turn = 2 * std::numbers::pi * k / ArmCapsules::kMostHeld;
    out->arm.hold({0, 0, 0.1}, {0.05 * std::cos(turn), 0.05 * std::sin(turn), 0.15}, 0.01);
  }
  ArmCapsules::Place at_home;
  out->arm.place(Vector7::Map(models::kHome.data()), at_home);
  constexpr double kRoom = 0.04;  // m
  constexpr int kMeshes = Walls::kMost / 2;
  constexpr std::uint32_t kAround = Walls::kMostTriangles / kMeshes / 2;
  constexpr double kSize = 0.02;  // m
  std::vector<Vector3> corners = {{0, 0, kSize}, {0, 0, -kSize}};
  std::vector<std::array<std::uint32_t, 3>> triangles;
  for (std::uint32_t k = 0; k < kAround; ++k) {
    const double turn = 2 * std::numbers::pi * k / kAround;
    corners.push_back(kSize * Vector3(std::cos(turn), std::sin(turn), 0));
    const std::uint32_t here = k + 2, next = (k + 1) % kAround + 2;
    triangles.push_back({0, here, next});
    triangles.push_back({1, next, here});
  }
  const auto mesh = std::make_shared<Mesh>(corners, triangles);
  for (int k = 0; k < Walls::kMost; ++k) {
    Shape shape{Shape::Kind::kBox, Vector3::Constant(kSize), Eigen::Isometry3d::Identity()};
    if (k % 2 == 0) shape.kind = Shape::Kind::kMesh, shape.mesh = mesh;
    const double turn = 2.4 * k, down = std::acos(1 - 2 * (k + 0.5) / Walls::kMost);  // evenly on a ball
    const Vector3 out_of_hand(std::sin(down) * std::cos(turn), std::sin(down) * std::sin(turn), std::cos(down));
    // As near as leaves the arm some room.
    for (double away = 0.1; away == 0.1 || gap(out->arm, at_home, shape) < kRoom; away += 0.01) {
      shape.O_T_S.translation() = Vector3(0.31, 0, 0.5) + away * out_of_hand;
    }
    out->walls.push_back({static_cast<std::uint32_t>(k + 1), shape});
  }
  return out;
}

// us of each cycle of guards alone.
std::vector<double> of_guards(std::unique_ptr<Walls> walls) {
  std::mt19937 random(1);
  const auto uniform = [&](double size) { return std::uniform_real_distribution<>(-size, size)(random); };
  Model model(models::urdf(models::arm("fr3"), 10));
  WallGuard guard;
  const ArmCapsules& arm = walls->arm;
  guard.change(walls.release());
  SelfGuard self;
  std::vector<double> us;
  std::array<Vector7, WallGuard::kMostOnWay> way;
  int held = 0;
  for (int n = 0; n < kCycles; ++n) {
    Vector7 q = Vector7::Map(models::kHome.data()), dq, tau = Vector7::Zero();
    for (int i = 0; i < 7; ++i) q[i] += uniform(0.2), dq[i] = uniform(0.5);
    model.update(q, dq);
    // Each joint to rest at a constant rate.
    for (std::size_t k = 0; k < way.size(); ++k) {
      const double s = static_cast<double>(k + 1) / static_cast<double>(way.size());
      way[k] = q + dq.cwiseProduct(dq.cwiseAbs()) / (2 * kBrake) * (2 * s - s * s);
    }
    const Matrix7 mobility = joint_mobility(model.mass());  // is there in any case
    const auto begin = std::chrono::steady_clock::now();
    const bool clear_of_itself = self.clear(arm, q, way, kSelfClearance);
    const bool clear = guard.clear(q, way, WallGuard::kClearance) && clear_of_itself;
    if (!clear) {
      WallGuard::Bounds of_walls;
      SelfGuard::Bounds of_itself;
      const Vector7 past = past_bounds(0.001 * dq, clear_of_itself ? guard.bounds(of_walls) : self.bounds(arm, q, of_itself));
      for (Vector7& place : way) place += 0.001 * past;
      self.clear(arm, q, way, kSelfClearance);
      guard.clear(q, way, WallGuard::kClearance);
    }
    guard.look(q, dq, dq);
    guard.add(dq, mobility, model.coriolis(), tau);
    us.push_back(1e-3 * static_cast<double>((std::chrono::steady_clock::now() - begin).count()));
    held += !clear;
  }
  std::fprintf(stderr, "%.0f %% of %d cycles with a wall or the arm itself in the way\n", 100. * held / kCycles, kCycles);
  return us;
}

double processor_us() {
  timespec now;
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}

// us of each cycle of an arm whose torques follow motions to random places about home.
std::vector<double> of_gates(std::unique_ptr<Walls> walls) {
  std::mt19937 random(1);
  std::uniform_real_distribution<> some(-1, 1);
  const models::Limits& limits = models::limits(models::arm("fr3"), 10);
  Model model(models::urdf(models::arm("fr3"), 10));
  MotionGate gate(limits, model);
  TorqueGate torques(limits);
  gate.keep_from(walls.release());
  fci::RobotState state{};
  Cycle cycle{state, model};
  Reference reference, wanted;
  reference.joint.q = Vector7::Map(models::kHome.data());
  gate.place(reference.joint.q);
  gate.reset(reference);
  Vector7 tau_J_d = Vector7::Zero();
  std::vector<double> us;
  int held = 0;
  for (int n = 0; n < kCycles; ++n) {
    if (n % kGoal == 0) {
      for (int i = 0; i < 7; ++i) wanted.joint.q[i] = models::kHome[i] + 0.4 * some(random);
    }
    cycle.q = reference.joint.q;
    cycle.dq = reference.joint.dq;
    model.update(cycle.q, cycle.dq);
    const Vector7 gravity = model.gravity({0, 0, -9.81});
    const double begin = processor_us();
    gate.observe(reference, gravity, nullptr);
    const HeldBy by = gate.follow(wanted, reference);
    cycle.q_ref = gate.joints().q;
    cycle.dq_ref = gate.joint_velocity();
    const Vector7 tau = felt_inertia(model.mass()) * reference.joint.ddq + model.coriolis();
    torques.pass(cycle, gate.walls(), tau, 0, tau_J_d);
    us.push_back(processor_us() - begin);
    held += has(by, HeldBy::kWall) || has(by, HeldBy::kItself);
  }
  std::fprintf(stderr, "%.0f %% of %d cycles with a wall or the arm itself in the way of a motion\n", 100. * held / kCycles, kCycles);
  return us;
}

}  // namespace

int main() {
  const models::Arm& arm = models::arm("fr3");
  const std::vector<double> us = of_guards(boxes_about(arm));
  std::vector<double> most = of_gates(most_about(arm));
  for (int pass = 1; pass < kPasses; ++pass) {
    const std::vector<double> again = of_gates(most_about(arm));
    std::ranges::transform(most, again, most.begin(), [](double a, double b) { return std::min(a, b); });
  }
  std::printf(
      "{\"safety_us_p50\": %.3f, \"safety_us_p99\": %.3f, \"safety_most_us_p50\": %.3f, \"safety_most_us_p99\": %.3f, "
      "\"safety_most_us_max\": %.3f}\n",
      percentile(us, 0.5), percentile(us, 0.99), percentile(most, 0.5), percentile(most, 0.99), std::ranges::max(most));
}
