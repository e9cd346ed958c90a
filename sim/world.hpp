#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "models/arm.hpp"

namespace sim {

using Vector6 = std::array<double, 6>;
using Vector7 = std::array<double, 7>;

// What the arm's sensors see and what the truth file tells, at the end of a cycle; forces and accelerations are those
// of the cycle. SI units, base frame O.
struct Truth {
  double time = 0;  // s of simulated time
  Vector7 q{};
  Vector7 dq{};
  Vector7 ddq{};        // mean over the cycle
  Vector7 tau_motor{};  // applied at the joints, N m
  Vector7 tau_J{};      // at the links, behind the joint's friction and motor inertia, N m
  std::array<double, 2> finger{};        // opening of each finger, m
  std::array<double, 2> finger_force{};  // grip force of each finger: what it touches pushes it open with this, N
  std::array<double, 16> O_T_TCP{};      // tool centre of the hand (of the flange without a hand), column-major
  // Of the world (held things included) on hand and fingers, at the TCP, axes of O; N, N m. push() is not in it.
  Vector6 contact_wrench{};
};

// The physical world in MuJoCo: one arm with its hand, and a scene. Nothing here knows of the protocol or of what was
// commanded except the torques. The same torques give the same bits.
class World {
 public:
  struct Options {
    const models::Arm* arm = nullptr;
    std::string scene;   // MJCF file around the arm; empty: floor only
    bool ideal = false;  // no joint friction
    bool hand = true;
    Vector7 q = models::kHome;
    double timestep = 1e-3;  // s, of the physics; 1 ms or an integer part of it
  };

  // Throws std::runtime_error which names the file and what is missing or wrong in it.
  explicit World(const Options& options);
  ~World();

  // One cycle of 1 ms: motor torques at the joints (gravity compensation included by the caller) and the force (N) that
  // drives each finger open (> 0) or closed (< 0). The fingers are geared together as the hand's are.
  void step(const Vector7& tau_motor, const std::array<double, 2>& finger_force);

  // Someone pushes the hand: force and moment (N, N m; axes of O) at the TCP, until the next call.
  void push(const Vector6& wrench);

  const Truth& truth() const;

  // Free bodies of the scene by name, for the truth file: position and quaternion (w, x, y, z) each, in O.
  std::vector<std::string> objects() const;
  std::array<double, 7> object_pose(std::size_t index) const;

  // Positions of all joints as MuJoCo has them, for the truth file and for pictures.
  std::vector<double> qpos() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace sim
