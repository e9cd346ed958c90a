#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "models/arm.hpp"

namespace sim {

using Vector6 = std::array<double, 6>;
using Vector7 = std::array<double, 7>;

// What the arm's sensors see and what the truth file tells; SI units, base frame O.
struct Truth {
  double time = 0;  // s of simulated time
  Vector7 q{};
  Vector7 dq{};
  Vector7 ddq{};
  Vector7 tau_motor{};     // applied at the joints, N m
  Vector7 tau_J{};         // at the links, behind the joint's friction and motor inertia, N m
  std::array<double, 2> finger{};        // opening of each finger, m
  std::array<double, 2> finger_force{};  // grip force of each finger, N
  std::array<double, 16> O_T_TCP{};      // tool centre of the hand, column-major
  Vector6 contact_wrench{};  // of the world on everything behind the flange, at the TCP, axes of O; N, N m
};

// The physical world in MuJoCo: one arm with its hand, and a scene. Nothing here knows of the
// protocol or of what was commanded except the torques.
class World {
 public:
  struct Options {
    const models::Arm* arm = nullptr;
    std::string scene;   // MJCF file around the arm; empty: floor only
    bool ideal = false;  // no joint friction, no sensor noise
    bool hand = true;
    Vector7 q = models::kHome;
  };

  // Throws std::runtime_error which names the file and what is missing or wrong in it.
  explicit World(const Options& options);
  ~World();

  // One cycle of 1 ms: motor torques at the joints (gravity compensation included by the caller) and
  // the force (N) that drives each finger open (> 0) or closed (< 0).
  void step(const Vector7& tau_motor, const std::array<double, 2>& finger_force);

  // Wrench (N, N m; axes of O, at the tool centre) that pushes the hand from now on.
  void push(const Vector6& wrench);

  const Truth& truth() const;

  // Free bodies of the scene by name, for the truth file: position and quaternion (w, x, y, z) each.
  std::vector<std::string> objects() const;
  std::array<double, 7> object_pose(std::size_t index) const;

  // The whole state as MuJoCo has it, for the truth file and for pictures.
  std::vector<double> qpos() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace sim
