#include "server/wall_store.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "server/refused.hpp"

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
    store.change(put(sphere("bench", 0.2, true)));
    store.change(put(sphere("visitor", 0.3, false)));
  }
  {
    WallStore store({}, -1, file_);
    EXPECT_EQ(names(store), Names{"bench"});
    EXPECT_EQ(store.list().walls(0).sphere().radius(), 0.2);
    store.change(put(sphere("pen", 0.1, true)));
    store.change(put(sphere("bench", 0.2, false)));
  }
  WallStore store({}, -1, file_);
  EXPECT_EQ(names(store), Names{"pen"});
  proto::ChangeWalls change;
  change.add_remove("pen");
  store.change(change);
  EXPECT_TRUE(names(WallStore({}, -1, file_)).empty());
}

TEST_F(WallStoreTest, the_configuration_goes_before_what_was_kept) {
  WallStore({}, -1, file_).change(put(sphere("bench", 0.2, true)));
  const WallStore store({sphere("bench", 0.4, false)}, -1, file_);
  ASSERT_EQ(names(store).size(), 1u);
  EXPECT_EQ(store.list().walls(0).sphere().radius(), 0.4);
  EXPECT_TRUE(store.list().walls(0).fixed());
}

TEST_F(WallStoreTest, a_file_that_is_none_is_left_out) {
  std::filesystem::create_directories(folder_ / "walls");
  std::ofstream(file_) << "no walls";
  WallStore store({}, -1, file_);
  EXPECT_TRUE(names(store).empty());
  store.change(put(sphere("bench", 0.2, true)));
  EXPECT_EQ(names(WallStore({}, -1, file_)).size(), 1u);
}

TEST_F(WallStoreTest, what_cannot_be_kept_is_not_there) {
  std::filesystem::create_directories(folder_);
  std::ofstream(folder_ / "walls") << "a file, and no folder";
  WallStore store({}, -1, file_);
  EXPECT_THROW(store.change(put(sphere("bench", 0.2, true))), std::exception);
  EXPECT_TRUE(names(store).empty());
}

}  // namespace
}  // namespace server
