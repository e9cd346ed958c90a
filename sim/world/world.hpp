#pragma once

#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "models/arm.hpp"
#include "sim/world/scene.hpp"

namespace sim {

using Vector3 = std::array<double, 3>;
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
  Vector6 push{};  // of push() and pull() on the arm, wherever, taken at the TCP; N, N m
};

// What drives an arm in a cycle.
struct Drive {
  Vector7 tau_motor{};                   // N m at the joints; compensation of gravity included
  std::array<double, 2> finger_force{};  // N, opens (> 0) or closes (< 0) each finger; they are geared together
};

// Where somebody takes hold of an arm.
struct Hold {
  static constexpr int kHand = 8;
  int link = kHand;              // 0 to 7, or the hand
  std::optional<Vector3> point;  // m in O, fixed to the link from now on; otherwise the link's origin, of the hand the TCP
};

// Somebody's hand: a spring and a damper between a point of the arm and one that moves.
struct VirtualHand {
  struct Waypoint {
    double time;  // s from now
    Vector3 position;  // m in O
  };
  std::vector<Waypoint> path;  // gone along evenly, from where the arm's point is; the last is stayed at
  double stiffness = 0;        // N/m
  double damping = 0;          // N s/m
  double max_force = 0;        // N
};

// A rigid thing.
struct Object {
  enum class Shape { kBox, kSphere, kCylinder, kCapsule };
  std::string name;
  Shape shape = Shape::kBox;
  // m: lengths of the sides; radius; radius and length along z (of a capsule without its caps).
  Vector3 size{};
  double mass = 0;              // kg; 0: it does not move
  std::array<double, 7> pose{0, 0, 0, 1, 0, 0, 0};  // position, quaternion w x y z in O
  double friction = 0.6;        // sliding
  std::array<float, 3> colour{0.9f, 0.33f, 0.16f};
};

// The physical world in MuJoCo: arms with their hands, and a scene. Nothing here knows of the protocol or of what was
// commanded except the torques. The same torques give the same bits. Arms are counted from 0; O is an arm's own base.
class World {
 public:
  struct Options {
    const models::Arm* arm = nullptr;
    std::vector<const models::Arm*> more_arms;  // in the same scene
    std::string scene;   // MJCF file around the arms, or the name of one of ours; empty: floor only
    bool ideal = false;  // no joint friction
    bool hand = true;
    Vector7 q = models::kHome;
    double timestep = 1e-3;  // s, of the physics; 1 ms or an integer part of it
  };
  // Everything that step() changes.
  struct Moment;

  // Throws std::runtime_error which names the file and what is missing or wrong in it.
  explicit World(const Options& options);
  ~World();

  std::size_t arms() const;
  // One cycle of 1 ms, with a drive for each arm, in two parts: move() has what sensors see; settle() follows it before
  // anything else is asked for, with the poses, and is what can wait until the sensors' values are under way.
  void move(std::span<const Drive> drives);
  void settle();
  void step(std::span<const Drive> drives);
  void step(const Vector7& tau_motor, const std::array<double, 2>& finger_force) {
    const Drive drive{tau_motor, finger_force};
    step({&drive, 1});
  }
  const Truth& truth(std::size_t arm = 0) const;

  // --- people -------------------------------------------------------------------------------------------------

  // Somebody pushes: force and moment (N, N m; axes of O) for so many seconds, or until the next call.
  void push(const Vector6& wrench, double duration = std::numeric_limits<double>::infinity(), std::size_t arm = 0,
            const Hold& at = {});
  // Somebody takes the arm by the hand, for so many seconds or until the next call; an empty path lets go.
  void pull(const VirtualHand& hand, double duration, std::size_t arm = 0, const Hold& at = {});
  // Puts a free body there, at rest. Throws std::runtime_error which names those that there are.
  void move_object(const std::string& name, const std::array<double, 7>& pose, std::size_t arm = 0);
  // Takes some 0.1 s. Throws std::runtime_error when it cannot be.
  void add_object(const Object& object, std::size_t arm = 0);
  // Sliding friction of a body's or geom's contacts with anything. Throws std::runtime_error for an unknown name.
  void set_friction(const std::string& name, double friction);

  // --- everything ---------------------------------------------------------------------------------------------

  std::shared_ptr<const Moment> save();
  // Throws std::runtime_error when there are other objects now.
  void restore(const Moment& moment);

  // Bodies of the scene that move, by name: position and quaternion (w, x, y, z) each, in O.
  const std::vector<std::string>& objects() const;
  std::array<double, 7> object_pose(std::size_t index, std::size_t arm = 0) const;

  // Positions of all joints as MuJoCo has them, for the truth file and for pictures. What was added comes last.
  std::span<const double> qpos() const;
  // What pictures are made of: a copy of the scene, and a number that changes with it.
  int changes() const;
  SpecPtr spec() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace sim
