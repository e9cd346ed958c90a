#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "realtime/held_by.hpp"
#include "realtime/model.hpp"
#include "realtime/walls/arm_capsules.hpp"
#include "realtime/walls/past_bounds.hpp"
#include "realtime/walls/shape.hpp"

namespace realtime {

struct Wall {
  std::uint32_t id;  // not 0
  Shape shape;
};

// What an arm must not touch, and its own body. Made in the server room, and not changed after.
struct Walls {
  static constexpr int kMost = 64;
  static constexpr int kMostTriangles = 512;  // of all meshes: what the loop can look at in a cycle

  ArmCapsules arm;
  std::vector<Wall> walls;  // kMost at most
};

// Keeps an arm clear of walls. Motions: at each cycle the whole way on which the arm would come to rest if it braked from there
// is looked at, so that there is always one that is clear, however thin a wall is. Torques: what a controller's torque makes of
// the joints, ddq = M^-1 (tau_J_d - c), may take no capsule nearer to a wall, or to another of the arm, at a speed that could not
// be braked in time (a control barrier, as JointBarrier), nor may a torque lead to such a speed before one that brakes can have taken
// its place; and from kClearance, or kSelfClearance, on a spring pushes back, as long
// as the arm does not yield to it. A wall that comes where the arm is deep inside does not push: there it is braked alone, and so it
// is where something that it now holds lies deep inside the arm.
class WallGuard {
 public:
  static constexpr double kClearance = 0.01;   // m from a wall, where motions end and a spring begins
  static constexpr double kTurnAround = 0.003;  // m more, of walls or itself, that a motion needs which has been held back
  static constexpr int kMostOnWay = 12;

  WallGuard() = default;
  ~WallGuard();
  WallGuard(const WallGuard&) = delete;

  // From now on these (null: none); returns those before, for their owner to destroy.
  Walls* change(Walls* walls) noexcept;
  // A motion begins, wherever the arm was led meanwhile.
  void begin() noexcept;
  bool active() const noexcept { return walls_ != nullptr && !walls_->walls.empty(); }
  // The body of the arm; null before change().
  const ArmCapsules* arm() const noexcept { return walls_ != nullptr ? &walls_->arm : nullptr; }

  // Whether the arm keeps `clearance` from each wall on that way of the joints (rad) from q on; `or_so`: or comes no nearer to a wall
  // that is nearer at q.
  bool clear(const Vector7& q, std::span<const Vector7> way, double clearance, bool or_so = true) noexcept;

  // What keeps a change of the joints, from where they were in the last clear(), kClearance away from what was near there.
  using Bounds = std::array<JointBound, kMostBounds>;
  std::span<const JointBound> bounds(Bounds& out) noexcept;

  // Once in a cycle of torques: where the arm is, and what velocity the torque that acts may bring it to (rad/s). Then what is added
  // to tau_J_d, N m; `mobility` is joint_mobility() there, c the Coriolis torque (N m). Returns for what: kWall, kItself.
  void look(const Vector7& q, const Vector7& dq, const Vector7& dq_to_come) noexcept;
  HeldBy add(const Vector7& dq, const Matrix7& mobility, const Vector7& c, Vector7& tau_J_d) noexcept;

  // After add(): how much faster than it could be braked the arm would come near to something if at dq the torque is `tau` beside c,
  // and then changes at `rate` (N m/s) to what brakes; m/s. The other has what asks for that braked from now on; whether anything does.
  double too_fast(const Vector7& dq, const Matrix7& mobility, const Vector7& rate, const Vector7& tau) const noexcept;
  bool brake_too_fast(const Vector7& dq, const Matrix7& mobility, const Vector7& rate, const Vector7& tau) noexcept;

  // The wall that stood in the way, the last time one did; 0: none yet. It may be no more.
  std::uint32_t wall() const noexcept { return wall_; }

 private:
  static constexpr double kUnknown = std::numeric_limits<double>::infinity();
  // Of a capsule and a wall: a plane that all of the wall is behind, as it was found when that was last asked for; and what is nearest at
  // the posture of clear(), which several looks from there have in common.
  struct Pair {
    // What lies between a and b is no nearer to the wall than that, m.
    double at_least(const Vector3& a, const Vector3& b) const noexcept { return std::min(normal.dot(a), normal.dot(b)) - height; }
    void keep(const Nearest& found) noexcept;

    Vector3 normal = Vector3::Zero();
    double height = kUnknown;  // m
    std::uint64_t posture = 0;
    Nearest nearest;
    bool in_the_way = false;
  };
  static constexpr int kMostContacts = kMostBounds;
  // Of what is near, at which acceleration (m/s²) at least it has to go away.
  struct Barrier {
    Vector7 gradient;
    double way;    // m to where the spring begins
    double least;
    int wall;      // -1: the arm itself
    Vector7 brake = Vector7::Zero();  // N m, that brakes it at kBrake
  };
  // Of a wall, or of the body of the arm, from when it came.
  struct Known {
    // In a cycle: how deep the arm is in it, m beyond where its spring begins.
    void look(double now) noexcept;
    double pushes() const noexcept { return inside ? 0 : share; }  // of its spring

    std::uint32_t id = 0;
    bool inside = false;  // it came, or moved, about the arm, which was deep in it then and has not left it
    double depth = -1;    // m, in the cycle before
    double share = 0;     // of its spring, that is there
  };

  const Nearest& nearest_here(int capsule, int wall) noexcept;
  void keep(const Barrier& barrier) noexcept;
  static double too_fast(const Barrier& barrier, const Vector7& dq, const Vector7& ddq, const Vector7& rate, const Vector7& tau) noexcept;
  // That they are farther from each other than `clearance`, m, where balls about both of them say so, or the plane between them.
  bool is_far(int capsule, int wall, const ArmCapsules::Place& place, double clearance) const noexcept;

  Walls* walls_ = nullptr;
  std::array<double, Walls::kMost> reach_{};  // of each wall, m
  std::array<Known, Walls::kMost> known_{};
  Known itself_;
  std::uint32_t wall_ = 0;

  std::array<std::array<Pair, Walls::kMost>, ArmCapsules::kMost> pairs_;
  Vector7 q_ = Vector7::Constant(std::numeric_limits<double>::quiet_NaN());  // in the last clear(), and its number
  std::uint64_t posture_ = 0;
  double clearance_ = 0;  // m, in the last clear()
  ArmCapsules::Place here_;
  std::array<ArmCapsules::Place, kMostOnWay> places_;
  std::array<Barrier, kMostContacts> barriers_;
  int barrier_count_ = 0;
  HeldBy near_ = HeldBy::kNothing;  // nearer than where a spring begins
};

}  // namespace realtime
