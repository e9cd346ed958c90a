#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "allocation_counter.hpp"
#include "home.hpp"
#include "mock_driver.hpp"
#include "realtime/controllers/joint_impedance.hpp"
#include "realtime/felt_inertia.hpp"
#include "realtime/loop.hpp"
#include "realtime/torque_gate.hpp"
#include "realtime/trajectories/min_jerk_joint.hpp"
#include "realtime/walls/mesh.hpp"
#include "realtime/walls/self_distance.hpp"
#include "realtime/walls/wall_guard.hpp"
#include "simulated_arm.hpp"
#include "walled.hpp"

namespace {

using namespace realtime;
using testing_tools::clearance_of;
using testing_tools::kTolerated;
using testing_tools::MockRobot;
using testing_tools::plane;
using testing_tools::SimulatedArm;
using testing_tools::too_fast;

const Vector7 kMotors = Vector7::Constant(0.05);  // kg m²

using Triangles = std::vector<std::array<std::uint32_t, 3>>;

// With a corner on each half of the axes.
const Triangles kOctahedron = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
std::vector<Vector3> octahedron(const Vector3& half) {
  std::vector<Vector3> corners;
  for (int i = 0; i < 3; ++i) {
    for (const double sign : {1., -1.}) corners.push_back(sign * half[i] * Vector3::Unit(i));
  }
  return corners;
}

// Corner i is at +half along the axes whose bit i has.
const Triangles kCube = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                         {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
std::vector<Vector3> cube(const Vector3& half) {
  std::vector<Vector3> corners;
  for (int i = 0; i < 8; ++i) corners.push_back(half.cwiseProduct(Vector3(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1)));
  return corners;
}

struct Random {
  std::mt19937 engine{17};
  double in(double low, double high) { return std::uniform_real_distribution<>(low, high)(engine); }
  Vector3 point(double size) { return {in(-size, size), in(-size, size), in(-size, size)}; }
  Shape shape(Shape::Kind kind) {
    Shape shape{kind, {in(0.05, 0.4), in(0.05, 0.4), in(0.05, 0.4)}, Eigen::Isometry3d(Eigen::Quaterniond::UnitRandom())};
    shape.O_T_S.translation() = point(0.5);
    if (kind == Shape::Kind::kMesh) shape.mesh = std::make_shared<Mesh>(octahedron(shape.size), kOctahedron);
    return shape;
  }
};
constexpr Shape::Kind kKinds[] = {Shape::Kind::kPlane, Shape::Kind::kBox, Shape::Kind::kCylinder, Shape::Kind::kCapsule,
                                  Shape::Kind::kMesh};

Shape box(const Vector3& centre, const Vector3& half) {
  Shape shape{Shape::Kind::kBox, half, Eigen::Isometry3d::Identity()};
  shape.O_T_S.translation() = centre;
  return shape;
}

// --- shapes --------------------------------------------------------------------------------------------------------------

TEST(Shape, the_normal_is_the_gradient_of_the_distance_and_leads_to_the_surface) {
  Random random;
  for (const Shape::Kind kind : kKinds) {
    for (int n = 0; n < 200; ++n) {
      const Shape shape = random.shape(kind);
      const Vector3 p = random.point(1);
      const Distance d = distance(shape, p);
      EXPECT_NEAR(d.normal.norm(), 1, 1e-9);
      EXPECT_NEAR(distance(shape, p - d.distance * d.normal).distance, 0, 1e-9);
      const Vector3 step = 1e-6 * random.point(1);
      EXPECT_NEAR(distance(shape, p + step).distance - d.distance, d.normal.dot(step), 1e-9) << static_cast<int>(kind);
    }
  }
}

TEST(Shape, distances_are_those_of_geometry) {
  EXPECT_NEAR(distance(plane({0, 0, 0.1}, Vector3::UnitZ()), {3, 4, 0.5}).distance, 0.4, 1e-12);
  const Shape cube = box(Vector3::Zero(), Vector3::Constant(1));
  EXPECT_NEAR(distance(cube, {2, 2, 2}).distance, std::sqrt(3.), 1e-12);
  EXPECT_NEAR(distance(cube, {2, 0.5, 0}).distance, 1, 1e-12);
  EXPECT_NEAR(distance(cube, {0.8, 0, 0}).distance, -0.2, 1e-12);
  const Shape cylinder{Shape::Kind::kCylinder, {0.5, 1, 0}, Eigen::Isometry3d::Identity()};
  EXPECT_NEAR(distance(cylinder, {1, 0, 0}).distance, 0.5, 1e-12);
  EXPECT_NEAR(distance(cylinder, {0, 0.2, 1.5}).distance, 0.5, 1e-12);
  const Shape capsule{Shape::Kind::kCapsule, {0.5, 1, 0}, Eigen::Isometry3d::Identity()};
  EXPECT_NEAR(distance(capsule, {0, 0, 2}).distance, 0.5, 1e-12);
}

TEST(Shape, a_mesh_of_a_box_is_a_box) {
  Random random;
  for (int n = 0; n < 50; ++n) {
    Shape given = random.shape(Shape::Kind::kBox), mesh = given;
    mesh.kind = Shape::Kind::kMesh;
    mesh.mesh = std::make_shared<Mesh>(cube(given.size), kCube);
    EXPECT_NEAR(reach(mesh), reach(given), 1e-12);
    for (int k = 0; k < 50; ++k) {
      const Vector3 p = given.O_T_S * random.point(0.6);  // inside as well
      const Distance expected = distance(given, p), found = distance(mesh, p);
      EXPECT_NEAR(found.distance, expected.distance, 1e-12);
      EXPECT_LT((found.normal - expected.normal).norm(), 1e-9);
    }
  }
}

// Rings about z, and how many corners each has.
Mesh ball(double radius, int rings, int around) {
  std::vector<Vector3> corners = {{0, 0, radius}};
  Triangles triangles;
  const auto at = [&](int ring, int k) -> std::uint32_t {
    return ring == 0 ? 0 : ring == rings ? 1 + (rings - 1) * around : 1 + (ring - 1) * around + k % around;
  };
  for (int ring = 1; ring < rings; ++ring) {
    for (int k = 0; k < around; ++k) {
      const double down = std::numbers::pi * ring / rings, turn = 2 * std::numbers::pi * k / around;
      corners.push_back(radius * Vector3(std::sin(down) * std::cos(turn), std::sin(down) * std::sin(turn), std::cos(down)));
    }
  }
  corners.push_back({0, 0, -radius});
  for (int ring = 0; ring < rings; ++ring) {
    for (int k = 0; k < around; ++k) {
      if (ring > 0) triangles.push_back({at(ring, k), at(ring + 1, k), at(ring, k + 1)});
      if (ring < rings - 1) triangles.push_back({at(ring, k + 1), at(ring + 1, k), at(ring + 1, k + 1)});
    }
  }
  return Mesh(corners, triangles);
}

// From outside the way over the surface ends where no point of the body is nearer: all of it is behind the plane through there.
TEST(Mesh, nothing_of_it_is_nearer_than_its_distance) {
  Random random;
  const auto body = ball(0.3, 8, 8);
  for (int n = 0; n < 5000; ++n) {
    const Vector3 p = random.point(0.6);
    const Distance found = body.distance(p);
    const Vector3 foot = p - found.distance * found.normal;
    EXPECT_NEAR(body.distance(foot).distance, 0, 1e-9);
    if (found.distance <= 0) continue;
    for (int k = 0; k < 10; ++k) {  // corners and others
      const Vector3 other = 0.3 * random.point(1).normalized(), of_it = other - std::max(0., body.distance(other).distance) * body.distance(other).normal;
      EXPECT_LE(found.normal.dot(of_it - foot), 1e-9);
    }
  }
}

TEST(Mesh, what_is_no_convex_body_is_refused_and_says_why) {
  const auto why = [](std::vector<Vector3> corners, const Triangles& triangles) -> std::string {
    try {
      Mesh(corners, triangles);
    } catch (const std::invalid_argument& refused) {
      return refused.what();
    }
    return "";
  };
  const auto corners = octahedron(Vector3::Constant(0.1));
  EXPECT_EQ(why(corners, kOctahedron), "");
  Triangles changed = kOctahedron;
  changed[0] = {0, 2, 6};
  EXPECT_EQ(why(corners, changed), "names corner 6 in triangle 0: expected 0 to 5");
  changed[0] = {2, 0, 4};
  EXPECT_EQ(why(corners, changed),
            "has the edge from corner 4 to 2 twice: expected each triangle once, its corners counter-clockwise seen from outside");
  changed.erase(changed.begin());
  EXPECT_EQ(why(corners, changed), "is not closed: there is a triangle on one side only of the edge from corner 0 to 4");
  for (auto& triangle : changed = kOctahedron) std::swap(triangle[0], triangle[1]);
  EXPECT_EQ(why(corners, changed),
            "is turned inside out: expected the corners of each triangle counter-clockwise seen from outside");
  EXPECT_EQ(why(octahedron({0.1, 0.1, 1e-9}), kOctahedron), "is flat: expected a body");
  auto dented = corners;
  dented[4] = {0, 0, -0.02};
  EXPECT_EQ(why(dented, kOctahedron),
            "is not convex: corner 1 is 38.5 mm outside the plane of triangle 0. Give its convex hull, or several bodies that are "
            "convex");
  dented = corners;
  dented[1] = dented[4];
  EXPECT_EQ(why(dented, kOctahedron), "has no area in triangle 1: leave it out");
}

TEST(Shape, no_point_of_a_segment_is_nearer_than_the_nearest) {
  Random random;
  for (const Shape::Kind kind : kKinds) {
    for (int n = 0; n < 200; ++n) {
      const Shape shape = random.shape(kind);
      const Vector3 a = random.point(1), b = random.point(1);
      const Nearest found = nearest(shape, a, b);
      double least = 1e9;
      for (int k = 0; k <= 200; ++k) least = std::min(least, distance(shape, a + (b - a) * k / 200).distance);
      EXPECT_LE(found.distance, least + 1e-9);
      EXPECT_TRUE(is_clear(shape, a, b, found.distance - 1e-9));
      EXPECT_FALSE(is_clear(shape, a, b, least + 1e-9));
      EXPECT_NEAR(distance(shape, found.point).distance, found.distance, 1e-12);
      EXPECT_LT((found.point - a).cross(b - a).norm(), 1e-9);
    }
  }
}

// --- the arm ---------------------------------------------------------------------------------------------------------------

TEST(ArmCapsules, gradients_are_those_of_finite_differences) {
  Random random;
  for (const char* name : {"fer", "fr3"}) {
    ArmCapsules arm(models::arm(name), true);
    ASSERT_TRUE(arm.hold({0, 0, 0.1}, {0, 0, 0.2}, 0.02));
    for (int n = 0; n < 20; ++n) {
      Vector7 q, dq;
      for (int i = 0; i < 7; ++i) q[i] = random.in(-2, 2), dq[i] = random.in(-1, 1);
      const Vector3 normal = random.point(1).normalized();
      ArmCapsules::Place here, there;
      arm.place(q, here);
      arm.place(q + 1e-6 * dq, there);
      for (int k = 0; k < static_cast<int>(arm.all().size()); ++k) {
        EXPECT_NEAR(normal.dot(there.b[k] - here.b[k]) / 1e-6, arm.gradient(here, k, here.b[k], normal).dot(dq), 1e-5);
      }
    }
  }
}

// Corners of the vendor's mesh of it, m in its frame.
TEST(ArmCapsules, one_is_around_all_of_the_hand) {
  const ArmCapsules arm(models::arm("fr3"), true);
  const ArmCapsules::Capsule& hull = arm.all().back();
  EXPECT_EQ(hull.link, ArmCapsules::kFlange);
  for (const Vector3& corner : {Vector3(-0.0316, -0.002, 0.0012), Vector3(0, -0.104, 0.0057), Vector3(0.0213, 0.0943, 0.0089),
                                Vector3(-0.0228, 0.0802, -0.0069), Vector3(0.0171, -0.0893, 0.0636), Vector3(-0.0016, 0.0975, 0.0623),
                                Vector3(0.0135, 0.0927, 0.0657), Vector3(-0.0009, -0.0825, -0.0259)}) {
    const Vector3 at = Eigen::AngleAxisd(models::hand::kYaw, Vector3::UnitZ()) * corner, way = hull.b - hull.a;
    const double along = std::clamp((at - hull.a).dot(way) / way.squaredNorm(), 0., 1.);
    EXPECT_LE((at - hull.a - along * way).norm(), hull.radius) << corner.transpose();
  }
}

TEST(ArmCapsules, no_point_of_them_moves_farther_than_it_reaches) {
  Random random;
  for (const double stick : {0., 0.3, 1.}) {
    ArmCapsules arm(models::arm("fr3"), true);
    if (stick > 0) {
      ASSERT_TRUE(arm.hold(Vector3::Zero(), {0.6 * stick, 0, 0.8 * stick}, 0.02));
    }
    double farthest = 0;
    for (int n = 0; n < 2000; ++n) {
      Vector7 q;
      for (int i = 0; i < 7; ++i) q[i] = random.in(-2.8, 2.8);
      ArmCapsules::Place place;
      arm.place(q, place);
      for (std::size_t k = 0; k < arm.all().size(); ++k) {
        for (int i = 0; i < std::min(arm.all()[k].link, models::kJoints); ++i) {
          for (const Vector3& end : {place.a[k], place.b[k]}) {
            farthest = std::max(farthest, place.axis[i].cross(end - place.origin[i]).norm() + arm.all()[k].radius);
          }
        }
      }
    }
    EXPECT_LE(farthest, arm.reach()) << stick;
    EXPECT_GT(farthest, 0.7 * arm.reach()) << stick;
  }
}

TEST(ArmCapsules, what_is_held_is_where_the_model_has_the_flange) {
  for (const char* name : {"fer", "fr3"}) {
    SimulatedArm simulated(name);
    ArmCapsules arm(models::arm(name), false);
    ASSERT_TRUE(arm.hold({0, 0, models::hand::kTcp}, {0, 0, models::hand::kTcp}, 0.01));
    ArmCapsules::Place place;
    arm.place(simulated.q, place);
    EXPECT_LT((place.a[arm.all().size() - 1] - simulated.cycle.O_T_EE.translation()).norm(), 1e-6);
  }
}

// However it was led there, and whatever it has seen on the way.
TEST(WallGuard, says_of_a_way_what_one_says_that_knows_nothing_yet) {
  Random random;
  std::vector<Wall> walls;
  for (int n = 0; n < 12; ++n) {
    Shape shape = random.shape(kKinds[1 + n % 4]);
    shape.size *= 0.2;
    shape.O_T_S.translation() *= 1.5;
    if (shape.mesh != nullptr) shape.mesh = std::make_shared<Mesh>(octahedron(shape.size), kOctahedron);
    walls.push_back({static_cast<std::uint32_t>(n + 1), shape});
  }
  const auto make = [&] {
    auto all = std::make_unique<Walls>(Walls{ArmCapsules(models::arm("fr3"), true), walls});
    EXPECT_TRUE(all->arm.hold({0, 0, 0.1}, {0, 0, 0.3}, 0.02));
    return all.release();
  };
  WallGuard guard;
  guard.change(make());
  int clear = 0, in_the_way = 0;
  Vector7 q = home();
  for (int n = 0; n < 3000; ++n) {
    const Vector7 step = Vector7::NullaryExpr([&] { return random.in(-1, 1); });
    q += (n % 100 == 0 ? 1 : 0.01) * step;
    std::array<Vector7, WallGuard::kMostOnWay> way;
    const double far = random.in(0, 0.3);
    for (std::size_t k = 0; k < way.size(); ++k) way[k] = q + far * static_cast<double>(k + 1) / way.size() * step;
    guard.look(q, step, step);
    for (const bool or_so : {true, false}) {
      WallGuard other;
      other.change(make());
      const bool is_clear = guard.clear(q, way, WallGuard::kClearance, or_so);
      ASSERT_EQ(is_clear, other.clear(q, way, WallGuard::kClearance, or_so)) << n;
      ++(is_clear ? clear : in_the_way);
      WallGuard::Bounds of_guard, of_other;
      const auto bounds = guard.bounds(of_guard), expected = other.bounds(of_other);
      ASSERT_EQ(bounds.size(), expected.size()) << n;
      for (std::size_t k = 0; k < bounds.size(); ++k) {
        EXPECT_EQ(bounds[k].gradient, expected[k].gradient);
        EXPECT_EQ(bounds[k].least, expected[k].least);
      }
    }
  }
  EXPECT_GT(clear, 500);
  EXPECT_GT(in_the_way, 500);
}

// --- motions ----------------------------------------------------------------------------------------------------------------

// The robot's own controller.
struct InternalImpedance : Controller {
  Channels takes() const noexcept override { return Channels::kJoint | Channels::kPose; }
  robot::Mode mode(Channels) const noexcept override {
    return {fci::ControllerMode::kJointImpedance, fci::MotionGeneratorMode::kJointPosition};
  }
  void start(const Cycle&, Reference&) noexcept override {}
  void step(const Cycle&, const Reference&, Vector7&) noexcept override {}
};

// A loop and its robot among walls.
class Walled : public testing::Test {
 protected:
  Walled() : robot(models::arm("fr3"), 10), model(models::urdf(models::arm("fr3"), 10)), loop(robot, model, robot.limits, {}, door) {}
  ~Walled() override {
    EXPECT_TRUE(robot.obeyed()) << robot.judgement();
    if (allocations::kCounts) {
      EXPECT_EQ(allocated, 0u);
    }
    collect();
  }

  void wall(const std::vector<Shape>& shapes) {
    auto walls = std::make_unique<Walls>(Walls{ArmCapsules(models::arm("fr3"), true), {}});
    for (const Shape& shape : shapes) walls->walls.push_back({static_cast<std::uint32_t>(walls->walls.size() + 1), shape});
    seen = *walls;
    door.walls.put(std::move(walls));
  }

  double clearance() const { return clearance_of(seen, robot.q()); }

  void give(std::unique_ptr<TrajectoryGenerator> trajectory, std::unique_ptr<Controller> controller) {
    auto skill = std::make_unique<Skill>();
    skill->id = ++given;
    skill->mode = controller->mode(motion_of(trajectory->fills()));
    skill->trajectory = std::move(trajectory);
    skill->controller = std::move(controller);
    door.next.put(std::move(skill));
  }
  void go_to(const Vector7& q, double duration, std::unique_ptr<Controller> controller = std::make_unique<InternalImpedance>()) {
    give(std::make_unique<MinJerkJoint>(MinJerkJoint::Parameters{q, duration}, robot.limits), std::move(controller));
  }

  // Cycles, of which it keeps the least clearance.
  void cycles(int n) {
    while (n-- > 0) {
      {
        const testing_tools::AllocationCounter counter;
        loop.cycle();
        allocated += counter.count();
      }
      least = std::min(least, clearance());
      collect();
    }
  }
  void collect() {
    while (const SkillResult* result = door.results.front()) results.push_back(*result), door.results.pop();
    while (Skill* const* skill = door.retired.front()) {
      delete *skill;
      door.retired.pop();
    }
    while (Walls* const* walls = door.former_walls.front()) {
      delete *walls;
      door.former_walls.pop();
    }
  }

  MockRobot robot;
  Model model;
  Door door;
  Loop loop;
  Walls seen{ArmCapsules(models::arm("fr3"), true), {}};
  std::vector<SkillResult> results;
  std::uint64_t given = 0;
  std::size_t allocated = 0;
  double least = 1e9;
};

TEST_F(Walled, a_motion_through_a_thin_wall_ends_before_it) {
  // Half a millimetre, in the way of the hand.
  wall({box({0.4, 0.25, 0.5}, {0.5, 0.00025, 0.5})});
  Vector7 goal = home();
  goal[0] = 1.2;
  for (const double duration : {1.5, 4.}) {
    least = 1e9;
    go_to(goal, duration);
    cycles(6000);
    ASSERT_FALSE(results.empty());
    EXPECT_EQ(results.back().ending, Ending::kTerminated);
    EXPECT_EQ(results.back().wall, 1u);
    EXPECT_GT(least, 0.0095);
    EXPECT_LT(clearance(), 0.015);
    EXPECT_LT(robot.dq().norm(), 1e-6);
    go_to(home(), 2);  // and back
    cycles(3000);
    EXPECT_LT((robot.q() - home()).norm(), 1e-3);
    EXPECT_EQ(results.back().wall, 0u);
  }
}

TEST_F(Walled, an_arm_that_dodges_comes_to_rest) {
  wall({box({0.4, 0.25, 0.5}, {0.5, 0.005, 0.5})});
  Vector7 goal = home();
  goal[0] = 0.9;
  for (const double duration : {2., 20.}) {
    go_to(goal, duration);
    cycles(static_cast<int>(1000 * duration) + 2000);
    ASSERT_EQ(results.back().ending, Ending::kTerminated);
    EXPECT_EQ(results.back().wall, 1u);
    EXPECT_LT(results.back().time, duration + 1.5);
    EXPECT_GT(least, 0.0095);
    go_to(home(), 2);
    cycles(3000);
    EXPECT_LT((robot.q() - home()).norm(), 1e-3);
  }
}

TEST_F(Walled, whatever_is_asked_for_nothing_is_touched) {
  Random random;
  wall({plane({0, 0, 0}, Vector3::UnitZ()), plane({0.65, 0, 0}, -Vector3::UnitX()), box({0.4, 0.35, 0.3}, {0.1, 0.05, 0.3}),
        box({0.45, -0.3, 0.2}, {0.15, 0.02, 0.2})});
  int walled = 0;
  for (int n = 0; n < 40; ++n) {
    Vector7 q;
    for (int i = 0; i < 7; ++i) q[i] = random.in(robot.limits.q_min[i] + 0.1, robot.limits.q_max[i] - 0.1);
    std::unique_ptr<Controller> controller = std::make_unique<InternalImpedance>();
    if (n % 2 == 1) {
      controller = std::make_unique<JointImpedance>(JointImpedance::Parameters{Vector7::Constant(300), Vector7::Constant(30)});
    }
    go_to(q, random.in(0.5, 3), std::move(controller));  // preempts
    cycles(static_cast<int>(random.in(200, 2500)));
    for (const SkillResult& result : results) walled += result.wall != 0;
    results.clear();
    EXPECT_GT(least, 0.002) << n;
  }
  EXPECT_GT(walled, 5);
}

TEST_F(Walled, an_arm_that_is_inside_may_only_go_away) {
  const Vector3 tips = SimulatedArm("fr3").cycle.O_T_EE.translation();
  wall({box(tips - Vector3(0, 0, 0.08), Vector3::Constant(0.1))});
  cycles(5);
  const double before = clearance();
  ASSERT_LT(before, 0);
  Vector7 down = home(), up = home();
  down[1] += 0.3;
  up[1] -= 0.3;
  go_to(down, 2);
  cycles(3000);
  EXPECT_GT(least, before - 1e-4);
  go_to(up, 2);
  cycles(3000);
  EXPECT_GT(clearance(), 0.01);
  EXPECT_LT((robot.q() - up).norm(), 0.01);
}

TEST_F(Walled, walls_come_and_go_while_a_skill_runs) {
  Vector7 goal = home();
  goal[0] = 1;
  go_to(goal, 2);
  cycles(500);
  wall({box({0.4, 0.3, 0.5}, {0.5, 0.02, 0.5})});
  cycles(4000);
  EXPECT_GT(clearance(), 0.0095);
  EXPECT_EQ(results.back().wall, 1u);
  go_to(goal, 2);
  cycles(200);
  wall({});
  cycles(3000);
  EXPECT_LT((robot.q() - goal).norm(), 1e-3);
}

// --- torque --------------------------------------------------------------------------------------------------------------------

// One cycle of an arm without a spring of its own, which somebody pushes along x of O with so many N.
void pushed_step(SimulatedArm& arm, WallGuard& guard, double force) {
  Vector7 tau = arm.cycle.model.coriolis() - Vector7::Constant(1).cwiseProduct(arm.dq);
  guard.look(arm.q, arm.dq, arm.dq);
  guard.add(arm.dq, joint_mobility(arm.model.mass()), arm.model.coriolis(), tau);
  arm.step(tau, arm.model.jacobian().transpose() * (force * Vector6::Unit(0)));
}

class PushedBack : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Arms, PushedBack, testing::Values("fer", "fr3"), [](const auto& info) { return std::string(info.param); });

TEST_P(PushedBack, an_arm_without_a_spring_of_its_own_stops_before_a_wall_and_is_held_off_it) {
  SimulatedArm arm(GetParam(), kMotors);
  WallGuard guard;
  auto* walls = new Walls{ArmCapsules(models::arm(GetParam()), true), {}};
  const double ahead = arm.cycle.O_T_EE.translation().x() + 0.25;
  walls->walls.push_back({1, plane({ahead, 0, 0}, -Vector3::UnitX())});
  ASSERT_EQ(guard.change(walls), nullptr);
  const auto clearance = [&] { return clearance_of(*walls, arm.q); };
  double fastest = 0, least = 1e9;
  for (int k = 0; k < 6000; ++k) {
    fastest = std::max(fastest, (arm.model.jacobian() * arm.dq)[0]);
    pushed_step(arm, guard, 30);  // towards the wall
    least = std::min(least, clearance());
  }
  EXPECT_GT(fastest, 0.3);
  EXPECT_GT(least, 0);
  EXPECT_LT(clearance(), 0.03);
  EXPECT_LT(std::abs((arm.model.jacobian() * arm.dq)[0]), 0.02);
}

// A wall that comes where the arm is, as one with its normal the wrong way: it is held, and what leads it out may.
TEST_P(PushedBack, an_arm_that_a_wall_comes_about_is_not_flung_out) {
  for (const double depth : {0.015, 0.1, 0.5}) {
    SimulatedArm arm(GetParam(), kMotors);
    WallGuard guard;
    const ArmCapsules body(models::arm(GetParam()), true);
    guard.change(new Walls{body, {}});
    const Eigen::Vector3d begin = arm.cycle.O_T_EE.translation();
    double fastest = 0, out = 0;
    const auto run = [&](int cycles, double force) {
      for (int k = 0; k < cycles; ++k) {
        pushed_step(arm, guard, force);
        fastest = std::max(fastest, (arm.model.jacobian() * arm.dq).head<3>().norm());
      }
      out = begin.x() - arm.cycle.O_T_EE.translation().x();
    };
    run(200, 0);
    auto* walls = new Walls{body, {{1, plane({begin.x() - depth, 0, 0}, -Vector3::UnitX())}}};
    delete guard.change(walls);
    run(1000, 0);
    EXPECT_LT(fastest, 0.15) << depth;
    if (depth > 0.05) {
      EXPECT_LT(std::abs(out), 0.01) << depth;
    }
    run(1500, -20);
    EXPECT_GT(out, 0.05) << "it may be led out, " << depth;
  }
}

// As an obstacle that is seen 20 times a second.
TEST_P(PushedBack, a_wall_that_moves_pushes_the_arm_before_it) {
  SimulatedArm arm(GetParam(), kMotors);
  WallGuard guard;
  Walls seen{ArmCapsules(models::arm(GetParam()), true), {{1, plane({0, 0, 0}, -Vector3::UnitX())}}};
  const double begin = arm.cycle.O_T_EE.translation().x();
  double least = 1e9;
  for (int k = 0; k < 7000; ++k) {
    if (k % 50 == 0) {
      seen.walls[0].shape.O_T_S.translation().x() = begin + 0.15 - std::min(0.05e-3 * k, 0.3);  // 0.05 m/s
      delete guard.change(new Walls(seen));
    }
    pushed_step(arm, guard, 20);
    least = std::min(least, clearance_of(seen, arm.q));
  }
  EXPECT_GT(least, -0.002);
  EXPECT_GT(begin - arm.cycle.O_T_EE.translation().x(), 0.14);
}

// Whatever stands about it, what is pressed against is not left out.
TEST_P(PushedBack, many_walls_hold_as_one_does) {
  for (const int count : {1, 64}) {
    SimulatedArm arm(GetParam(), kMotors);
    WallGuard guard;
    auto* walls = new Walls{ArmCapsules(models::arm(GetParam()), true), {}};
    const double ahead = arm.cycle.O_T_EE.translation().x() + 0.25;
    for (int k = count; k > 0; --k) {
      walls->walls.push_back({static_cast<std::uint32_t>(k), plane({ahead + 1e-4 * (k - 1), 0, 0}, -Vector3::UnitX())});
    }
    guard.change(walls);
    double least = 1e9;
    for (int k = 0; k < 4000; ++k) {
      pushed_step(arm, guard, 30);
      least = std::min(least, clearance_of(*walls, arm.q));
    }
    EXPECT_GT(least, 0) << count;
  }
}

TEST(SelfDistance, contacts_are_those_of_finite_differences) {
  const models::Limits& limits = models::limits(models::arm("fr3"), 10);
  const ArmCapsules bare(models::arm("fr3"), true);
  Random random;
  int seen = 0, of_stick = 0;
  for (int n = 0; n < 3000; ++n) {
    ArmCapsules body = bare;
    if (n % 2 == 1) {
      ASSERT_TRUE(body.hold({0, 0, 0.1}, {0, 0, 0.5}, 0.02));
    }
    Vector7 q;
    for (int i = 0; i < 7; ++i) q[i] = random.in(limits.q_min[i], limits.q_max[i]);
    ArmCapsules::Place place;
    body.place(q, place);
    std::array<SelfContact, 16> contacts;
    const std::size_t count = self_contacts(body, place, 0.1, contacts);
    const SelfDistance nearest = self_distance(body, q);
    if (count == 0) {
      EXPECT_GE(nearest.distance, 0.1);
      continue;
    }
    const SelfContact* least = std::min_element(contacts.begin(), contacts.begin() + static_cast<std::ptrdiff_t>(count),
                                                [](const auto& a, const auto& b) { return a.distance < b.distance; });
    EXPECT_NEAR(least->distance, nearest.distance, 1e-12);
    if (nearest.distance < 0) continue;  // there axes may meet
    ++seen;
    of_stick += nearest.distance < self_distance(bare, q).distance;
    constexpr double kStep = 1e-7;
    for (int i = 0; i < 7; ++i) {
      const Vector7 step = kStep * Vector7::Unit(i);
      const double slope = (self_distance(body, q + step).distance - self_distance(body, q - step).distance) / (2 * kStep);
      EXPECT_NEAR(least->gradient[i], slope, 1e-4) << "joint " << i + 1 << ", sample " << n;
    }
  }
  EXPECT_GT(seen, 100);
  EXPECT_GT(of_stick, 10);
}

// Whatever pulls it: nearer than where the robot stops it, it only creeps. What presses it together is 20 N m in two joints.
TEST_P(PushedBack, an_arm_that_is_led_against_itself_is_braked_before_the_robot_stops_it) {
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  for (const bool guarded : {false, true}) {
    SimulatedArm arm(GetParam(), Vector7::Map(models::kMotorInertia.data()));
    TorqueGate gate(limits);
    WallGuard guard;
    const ArmCapsules body(models::arm(GetParam()), true);
    if (guarded) guard.change(new Walls{body, {}});
    arm.q << 0, 0.2, 0, -2.6, 0, 1.2, 0;
    arm.observe();
    double before = self_distance(body, arm.q).distance, worst = 0;
    Vector7 sent = Vector7::Zero();
    for (int k = 0; k < 6000; ++k) {
      const Vector7 wanted = arm.model.coriolis() + (Vector7() << 0, 0, 0, -20, 0, -8, 0).finished() - 1 * arm.dq;
      const HeldBy held = gate.pass(arm.cycle, guard, wanted, 0, sent);
      arm.step(sent);
      const double distance = self_distance(body, arm.q).distance;
      if (distance < models::kCapsuleMargin) worst = std::max(worst, before - distance);
      if (distance < models::kCapsuleMargin && guarded) {
        EXPECT_TRUE(has(held, HeldBy::kItself));
      }
      before = distance;
    }
    EXPECT_LT(before, 0.04) << "it was led there";
    if (guarded) {
      EXPECT_LT(worst, 1e-5) << "m in a cycle";  // where the robot's reflex is
    } else {
      EXPECT_GT(worst, 1e-5);
    }
  }
}

// By stiff springs, to places beyond a wall and the floor as well: what would push it back may be more than its joints can give.
TEST_P(PushedBack, an_arm_that_swings_bears_no_more_than_it_can_and_is_no_faster_than_it_may) {
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  const Vector7 q_min = Vector7::Map(limits.q_min.data()), q_max = Vector7::Map(limits.q_max.data());
  const Vector7 tau_max = Vector7::Map(limits.tau_max.data());
  HeldBy held = HeldBy::kNothing;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    SimulatedArm arm(GetParam(), Vector7::Map(models::kMotorInertia.data()));
    TorqueGate gate(limits);
    WallGuard guard;
    guard.change(new Walls{ArmCapsules(models::arm(GetParam()), true),
                           {{1, plane({0.6, 0, 0}, -Vector3::UnitX())}, {2, plane({0, 0, 0}, Vector3::UnitZ())}}});
    std::mt19937 engine(seed);
    std::uniform_real_distribution<> some(0, 1);
    Vector7 goal = arm.q, sent = Vector7::Zero();
    double most = 0, fastest = 0;
    for (int cycle = 0; cycle < 6000; ++cycle) {
      if (cycle % 500 == 0) {
        for (int i = 0; i < models::kJoints; ++i) goal[i] = q_min[i] + some(engine) * (q_max[i] - q_min[i]);
      }
      const Vector7 pull = 3 * (goal - arm.q - 0.05 * arm.dq);
      held |= gate.pass(arm.cycle, guard, tau_max.cwiseProduct(pull) + arm.model.coriolis(), 0, sent);
      const Vector7 borne = (sent + arm.model.gravity({0, 0, -9.81})).cwiseAbs();
      most = std::max(most, borne.cwiseQuotient(tau_max).maxCoeff());
      arm.step(sent);
      fastest = std::max(fastest, too_fast(arm, limits));
    }
    EXPECT_LE(most, 1) << "seed " << seed;
    EXPECT_LT(fastest, kTolerated) << "seed " << seed;
  }
  EXPECT_TRUE(has(held, HeldBy::kWall));
}

// By a torque that takes as long to be brought back as it took to come.
TEST_P(PushedBack, an_arm_that_is_torn_towards_a_wall_stops_before_it) {
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  const Vector7 stiffness = (Vector7() << 0, 600, 600, 600, 50, 50, 50).finished();
  const Vector7 damping = (Vector7() << 0, 40, 40, 40, 5, 5, 5).finished();
  for (const double torque : {20., 50., 80.}) {
    for (const double ahead : {0.03, 0.1, 0.2, 0.3, 0.6}) {
      SimulatedArm arm(GetParam(), kMotors);
      TorqueGate gate(limits);
      WallGuard guard;
      arm.q << 0, 1.3, 0, -0.4, 0, 1.7, M_PI_4;
      arm.observe();
      const Vector7 begin = arm.q;
      auto* walls = new Walls{ArmCapsules(models::arm(GetParam()), true), {{1, plane(Vector3::Zero(), -Vector3::UnitY())}}};
      walls->walls[0].shape.O_T_S.translation().y() = ahead - clearance_of(*walls, arm.q);
      guard.change(walls);
      ASSERT_NEAR(clearance_of(*walls, arm.q), ahead, 1e-9);
      Vector7 sent = Vector7::Zero();
      double least = 1e9, fastest = 0;
      for (int k = 0; k < 3000; ++k) {
        Vector7 wanted = arm.model.coriolis() + stiffness.cwiseProduct(begin - arm.q) - damping.cwiseProduct(arm.dq);
        wanted[0] = torque;
        gate.pass(arm.cycle, guard, wanted, 0, sent);
        arm.step(sent);
        least = std::min(least, clearance_of(*walls, arm.q));
        fastest = std::max(fastest, (arm.model.jacobian() * arm.dq)[1]);
      }
      EXPECT_GT(least, 0) << torque << " N m, " << ahead << " m";
      EXPECT_LT(clearance_of(*walls, arm.q), 0.02) << torque << " N m, " << ahead << " m";
    }
  }
}

// It is damped alone, as one that its controller has let go: what holds it in two places would be pushed both ways.
TEST_P(PushedBack, an_arm_that_holds_what_lies_deep_in_itself_lies_still) {
  SimulatedArm arm(GetParam(), Vector7::Map(models::kMotorInertia.data()));
  TorqueGate gate(models::limits(models::arm(GetParam()), 10));
  WallGuard guard;
  auto* walls = new Walls{ArmCapsules(models::arm(GetParam()), true), {}};
  const Vector3 middle(-0.031, 0.046, 0.223), along(-0.031, 0.046, 0.123);
  ASSERT_TRUE(walls->arm.hold(middle - along, middle + along, 0.008));
  guard.change(walls);
  arm.q << 0.044, -0.682, -0.237, -2.343, -0.122, 0.6, 0.930;
  arm.dq[6] = 0.2;
  arm.observe();
  ASSERT_LT(self_distance(walls->arm, arm.q).distance, -0.03);
  const Vector7 damping = (Vector7() << 20, 20, 20, 20, 5, 5, 5).finished();
  Vector7 sent = Vector7::Zero();
  double fastest = 0, gone = 0;
  const Vector7 begin = arm.q;
  for (int k = 0; k < 4000; ++k) {
    gate.pass(arm.cycle, guard, arm.model.coriolis() - damping.cwiseProduct(arm.dq), 0, sent);
    arm.step(sent);
    gone = std::max(gone, (arm.q - begin).cwiseAbs().maxCoeff());
    if (k >= 1000) fastest = std::max(fastest, arm.dq.cwiseAbs().maxCoeff());
  }
  EXPECT_LT(gone, 0.02);
  EXPECT_LT(fastest, 2e-3);
}

// Fingers that lie along the shoulder, or along a table: the nearest place of a capsule leaps there between its ends.
TEST_P(PushedBack, an_arm_that_is_pressed_on_something_lies_still) {
  const models::Limits& limits = models::limits(models::arm(GetParam()), 10);
  for (const bool on_itself : {true, false}) {
    SimulatedArm arm(GetParam(), Vector7::Map(models::kMotorInertia.data()));
    TorqueGate gate(limits);
    WallGuard guard;
    auto* walls = new Walls{ArmCapsules(models::arm(GetParam()), true), {}};
    if (on_itself) {
      arm.q << 0, -0.5, 0, -2.7, 0, 1.1, M_PI_4;
      arm.observe();
    } else {
      walls->walls.push_back({1, box(arm.cycle.O_T_EE.translation() - Vector3(0, 0, 0.1), {0.2, 0.4, 0.05})});
    }
    guard.change(walls);
    Vector7 goal = arm.q;
    if (on_itself) goal[5] = 0.5;
    const Vector7 stiffness = (Vector7() << 600, 600, 600, 600, 250, 150, 50).finished();
    const Vector7 damping = (Vector7() << 50, 50, 50, 50, 30, 25, 15).finished();
    Vector7 sent = Vector7::Zero();
    double fastest = 0;
    for (int k = 0; k < 6000; ++k) {
      Vector7 wanted = arm.model.coriolis() + stiffness.cwiseProduct(goal - arm.q) - damping.cwiseProduct(arm.dq);
      if (!on_itself) wanted += arm.model.jacobian().transpose() * (Vector6() << 0, 0, -120, 0, 0, 0).finished();
      gate.pass(arm.cycle, guard, wanted, 0, sent);
      arm.step(sent);
      if (k >= 5000) fastest = std::max(fastest, arm.dq.cwiseAbs().maxCoeff());
    }
    EXPECT_LT(fastest, 2e-3) << "rad/s, " << (on_itself ? "on itself" : "on a table");
    const double left = on_itself ? self_distance(walls->arm, arm.q).distance - kSelfClearance : clearance_of(*walls, arm.q) - 0.01;
    EXPECT_NEAR(left, 0, 0.003);
  }
}

}  // namespace
