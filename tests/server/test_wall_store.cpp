#include "server/wall_store.hpp"

#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <span>

#include "server/kept.hpp"
#include "server/refused.hpp"
#include "server/shared_memory.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;

proto::Wall sphere(const std::string& name, double radius, bool keep) {
  proto::Wall wall;
  wall.set_name(name);
  wall.mutable_sphere()->set_radius(radius);
  for (const double each : {0., 2., 0.}) wall.add_position(each);
  for (const double each : {1., 0., 0., 0.}) wall.add_orientation(each);
  wall.set_keep(keep);
  return wall;
}

proto::ChangeWalls put(const proto::Wall& wall) {
  proto::ChangeWalls change;
  *change.add_put() = wall;
  return change;
}

// As a server does: first what is to be kept.
void make(WallStore& store, const proto::ChangeWalls& change, const Keys::Client& who = {"", "", proto::USER}) {
  if (const auto keep = store.kept_after(change, who)) save(store.file(), *keep);
  store.change(change, who);
}

std::vector<std::string> names(const WallStore& store) {
  std::vector<std::string> names;
  const proto::Walls walls = store.list();
  for (const proto::Wall& wall : walls.walls()) names.push_back(wall.name());
  return names;
}

class WallStoreTest : public testing::Test {
 protected:
  WallStoreTest() { std::filesystem::remove_all(folder_); }
  ~WallStoreTest() override { std::filesystem::remove_all(folder_); }

  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("wall_store_test_" + std::to_string(getpid()));
  const std::string file_ = folder_ / "walls" / "left@172.16.0.2";
};

TEST_F(WallStoreTest, what_is_to_be_kept_is_there_again_until_it_is_removed) {
  using Names = std::vector<std::string>;
  {
    WallStore store({}, -1, file_);
    make(store, put(sphere("bench", 0.2, true)));
    make(store, put(sphere("visitor", 0.3, false)));
  }
  {
    WallStore store({}, -1, file_);
    EXPECT_EQ(names(store), Names{"bench"});
    EXPECT_EQ(store.list().walls(0).sphere().radius(), 0.2);
    make(store, put(sphere("pen", 0.1, true)));
    make(store, put(sphere("bench", 0.2, false)));
  }
  WallStore store({}, -1, file_);
  EXPECT_EQ(names(store), Names{"pen"});
  proto::ChangeWalls change;
  change.add_remove("pen");
  make(store, change);
  EXPECT_TRUE(names(WallStore({}, -1, file_)).empty());
}

// The loop knows it again by its number, whose spring is there.
TEST_F(WallStoreTest, a_wall_that_moves_stays_itself) {
  WallStore store({}, -1, file_);
  const auto number = [&] { return store.make(models::arm("fr3"), true)->walls.at(0).id; };
  make(store, put(sphere("visitor", 0.3, false)));
  const std::uint32_t first = number();
  make(store, put(sphere("visitor", 0.2, false)));
  EXPECT_EQ(number(), first);
  EXPECT_EQ(store.name(first), "visitor");
  proto::ChangeWalls change = put(sphere("visitor", 0.2, false));
  change.add_remove("visitor");
  make(store, change);
  EXPECT_NE(number(), first);
}

proto::Wall mesh(const std::string& name, double offset) {
  proto::Wall wall = sphere(name, 1, false);
  wall.mutable_mesh();
  for (const double each : {0.1, 0., 0., -0.1, 0., 0., 0., 0.2, 0., 0., 0., 0.3}) wall.mutable_mesh()->add_corners(each + offset);
  for (const int each : {0, 1, 2, 0, 3, 1, 1, 3, 2, 0, 2, 3}) wall.mutable_mesh()->add_triangles(each);
  return wall;
}

TEST_F(WallStoreTest, a_mesh_is_where_its_corners_are) {
  WallStore store({});
  make(store, put(mesh("wedge", 0.5)));
  const auto made = store.make(models::arm("fr3"), true);
  ASSERT_EQ(made->walls.size(), 1u);
  const auto distance = [&](double x, double y, double z) { return realtime::distance(made->walls[0].shape, {x, y, z}).distance; };
  EXPECT_NEAR(distance(0.5, 2.5, 0.45), 0.05, 1e-12);  // its position is (0, 2, 0); below its bottom
  EXPECT_NEAR(distance(0.7, 2.5, 0.5), 0.1, 1e-12);
  EXPECT_LT(distance(0.5, 2.55, 0.55), 0);
  EXPECT_LT(realtime::reach(made->walls[0].shape), 0.25);
}

TEST_F(WallStoreTest, a_mesh_that_is_held_is_covered) {
  proto::Wall wall = mesh("wedge", 0.1);
  wall.set_held(true);
  for (int i = 0; i < 3; ++i) wall.set_position(i, 0);
  WallStore store({});
  make(store, put(wall));
  const auto made = store.make(models::arm("fr3"), true);
  const auto& capsule = made->arm.all().back();
  EXPECT_EQ(capsule.link, realtime::ArmCapsules::kFlange);
  const realtime::Vector3 axis = capsule.b - capsule.a;
  for (int i = 0; i < 12; i += 3) {
    const realtime::Vector3 corner = realtime::Vector3::Map(wall.mesh().corners().data() + i);
    const double along = std::clamp((corner - capsule.a).dot(axis) / axis.squaredNorm(), 0., 1.);
    EXPECT_LE((corner - capsule.a - along * axis).norm(), capsule.radius + 1e-12);
  }
}

TEST_F(WallStoreTest, a_mesh_that_is_no_body_is_refused_by_its_name) {
  WallStore store({});
  proto::Wall wall = mesh("wedge", 0);
  wall.mutable_mesh()->set_triangles(0, 7);
  try {
    make(store, put(wall));
    FAIL();
  } catch (const Refused& refused) {
    EXPECT_STREQ(refused.what(), "Wall \"wedge\" names corner 7 in triangle 0: expected 0 to 3");
  }
  wall.mutable_mesh()->add_corners(1);
  EXPECT_THROW(make(store, put(wall)), Refused);
  EXPECT_TRUE(names(store).empty());
}

// A corner in the middle of each triangle makes three of it.
proto::Wall finer(proto::Wall wall) {
  auto& of = *wall.mutable_mesh();
  const auto coarse = of.triangles();
  of.clear_triangles();
  for (int i = 0; i < coarse.size(); i += 3) {
    const auto middle = static_cast<std::uint32_t>(of.corners_size() / 3);
    for (int axis = 0; axis < 3; ++axis) {
      double sum = 0;
      for (int k = 0; k < 3; ++k) sum += of.corners(static_cast<int>(3 * coarse[i + k]) + axis);
      of.add_corners(sum / 3);
    }
    for (int k = 0; k < 3; ++k) {
      for (const auto corner : {coarse[i + k], coarse[i + (k + 1) % 3], middle}) of.add_triangles(corner);
    }
  }
  return wall;
}

TEST_F(WallStoreTest, meshes_have_no_more_triangles_than_the_loop_can_look_at) {
  const proto::Wall fine = finer(finer(finer(mesh("0", 0))));
  ASSERT_EQ(fine.mesh().triangles_size(), 3 * 108);
  WallStore store({});
  for (int k = 0; k < 5; ++k) {
    proto::Wall wall = fine;
    wall.set_name(std::to_string(k));
    if (k < 4) {
      make(store, put(wall));
    } else {
      EXPECT_THROW(make(store, put(wall)), Refused);
      wall.set_held(true);  // then it is a capsule
      make(store, put(wall));
    }
  }
}

TEST_F(WallStoreTest, the_configuration_goes_before_what_was_kept) {
  WallStore before({}, -1, file_);
  make(before, put(sphere("bench", 0.2, true)));
  const WallStore store({sphere("bench", 0.4, false)}, -1, file_);
  ASSERT_EQ(names(store).size(), 1u);
  EXPECT_EQ(store.list().walls(0).sphere().radius(), 0.4);
  EXPECT_TRUE(store.list().walls(0).fixed());
}

TEST_F(WallStoreTest, what_is_protected_only_the_lab_changes) {
  const int fd = make_memory_file("walls", 0);
  const Keys::Client student{"key", "anna", proto::USER}, lab{"key", "lab", proto::LAB};
  const std::vector<proto::Wall> configured = {sphere("bench", 0.4, false), sphere("pole", 0.1, false)};
  WallStore store(configured, fd, file_);
  const auto refusal = [&](const proto::ChangeWalls& change) {
    try {
      make(store, change, student);
    } catch (const Refused& refused) {
      EXPECT_EQ(refused.code, proto::Error::NOT_PERMITTED);
      return std::string(refused.what());
    }
    return std::string();
  };
  proto::ChangeWalls remove;
  remove.add_remove("bench");
  EXPECT_EQ(refusal(remove).find("wall \"bench\" is of the server's configuration: to change it needs the role lab, and"), 0u);
  EXPECT_NE(refusal(put(sphere("bench", 0.2, false))), "");
  auto table = sphere("table", 0.3, true);
  table.set_fixed(true);
  make(store, put(table), lab);
  EXPECT_EQ(refusal(put(sphere("table", 0.2, false))).find("wall \"table\" is protected"), 0u);
  auto own = sphere("own", 0.1, false);
  own.set_fixed(true);
  make(store, put(own), student);
  make(store, remove, lab);
  make(store, put(sphere("pole", 0.2, false)), lab);

  const auto shown = [](const WallStore& of) {
    std::string text;
    const proto::Walls walls = of.list();
    for (const auto& wall : walls.walls()) {
      text += fmt::format("{} {}{}, ", wall.name(), wall.sphere().radius(), wall.fixed() ? " fixed" : "");
    }
    return text;
  };
  EXPECT_EQ(shown(store), "own 0.1, pole 0.2, table 0.3 fixed, ");
  EXPECT_EQ(shown(WallStore(configured, fd, file_)), shown(store)) << "after a crash of its process";
  EXPECT_EQ(shown(WallStore(configured, -1, file_)), "bench 0.4 fixed, pole 0.1 fixed, table 0.3 fixed, ") << "of another server";
  close(fd);
}

TEST_F(WallStoreTest, a_file_that_cannot_be_read_is_no_file_without_walls) {
  std::filesystem::create_directories(folder_ / "walls");
  for (const char* text : {"no walls", ""}) {
    std::ofstream(file_) << text;
    EXPECT_THROW(WallStore({}, -1, file_), std::runtime_error) << '"' << text << '"';
  }
}

TEST_F(WallStoreTest, what_cannot_be_kept_is_not_there) {
  std::filesystem::create_directories(folder_);
  std::ofstream(folder_ / "walls") << "a file, and no folder";
  WallStore store({}, -1, file_);
  EXPECT_THROW(make(store, put(sphere("bench", 0.2, true))), std::exception);
  EXPECT_TRUE(names(store).empty());
}

TEST_F(WallStoreTest, a_thin_wall_between_two_samples_of_a_way_is_seen) {
  WallStore store({});
  proto::Wall wall;
  wall.set_name("glass");
  for (const double each : {1., 0.001, 1.}) wall.mutable_box()->add_size(each);
  for (const double each : {0.85, 0., 0.5}) wall.add_position(each);
  for (const double each : {1., 0., 0., 0.}) wall.add_orientation(each);
  make(store, put(wall));
  const auto walls = store.make(models::arm("fr3"), true);
  std::array<realtime::Vector7, 3> way;
  way.fill(realtime::Vector7::Map(models::kHome.data()));
  way[0][0] = -0.6;
  way[1][0] = way[2][0] = 0.6;
  check_walls(*walls, store, std::span(way).last(2), "this");
  try {
    check_walls(*walls, store, way, "this");
    ADD_FAILURE() << "it was let through";
  } catch (const Refused& refused) {
    EXPECT_NE(std::string(refused.what()).find("wall \"glass\" at "), std::string::npos) << refused.what();
  }
}

}  // namespace
}  // namespace server
