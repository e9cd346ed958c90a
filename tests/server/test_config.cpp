#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>

#include "robot/collision_behavior.hpp"
#include "server/config.hpp"

namespace server {
namespace {

const std::string kArm = "[[arm]]\nname = 'left'\naddress = '172.16.0.2'\n";  // three lines

std::string error_of(const std::string& toml) {
  try {
    parse_config(toml, "arms.toml");
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no error";
}

std::string many_walls(int count) {
  std::string text;
  for (int i = 0; i < count; ++i) text += "[[arm.wall]]\nname = 'w" + std::to_string(i) + "'\nshape = 'plane'\n";
  return text;
}

TEST(Config, ReadsEverything) {
  const Config config = parse_config(R"(
[server]
listen = "0.0.0.0"
port = 6000
[[arm]]
name = "left"
address = "172.16.0.2"
model = "fr3"
gripper = false
hold_time = 5
[arm.load]
mass = 0.5
center_of_mass = [0, 0, 0.05]
inertia = [1e-3, 0, 0, 0, 2e-3, 0, 0, 0, 3e-3]
[arm.tool]
translation = [0.0, 0.1, 0.2]
quaternion = [0.7071067811865476, 0, 0, 0.7071067811865476]
[arm.limits]
velocity = 0.5
tool_speed = 0.25
[arm.recovery]
errors = "ask"
collisions = "never"
user_stop = "itself"
times = 3
[arm.collision]
lower_torque_thresholds = [1, 2, 3, 4, 5, 6, 7]
upper_torque_thresholds = [10, 20, 30, 40, 50, 60, 70]
lower_force_thresholds = [1, 2, 3, 4, 5, 6]
upper_force_thresholds = [10, 20, 30, 40, 50, 60]
[[arm]]
name = "right"
address = "172.16.0.3"
)", "arms.toml");
  EXPECT_EQ(config.listen, "0.0.0.0");
  EXPECT_EQ(config.port, 6000);
  ASSERT_EQ(config.arms.size(), 2u);
  const ArmConfig& left = config.arms[0];
  EXPECT_EQ(left.model, "fr3");
  EXPECT_FALSE(left.gripper);
  EXPECT_EQ(left.hold_time, 5);
  EXPECT_EQ(left.limits.velocity, 0.5);
  EXPECT_EQ(left.limits.jerk, 1);
  EXPECT_EQ(left.limits.tool_speed, 0.25);
  EXPECT_FALSE(left.limits.power);
  using Policy = frankapy::proto::RecoveryPolicy;
  EXPECT_EQ(left.recovery.errors, Policy::ASK);
  EXPECT_EQ(left.recovery.collisions, Policy::NEVER);
  EXPECT_EQ(left.recovery.user_stop, Policy::ITSELF);
  EXPECT_EQ(left.recovery.times, 3u);
  ASSERT_TRUE(left.settings.load);
  EXPECT_EQ(left.settings.load->m_load, 0.5);
  EXPECT_EQ(left.settings.load->F_x_Cload[2], 0.05);
  EXPECT_EQ(left.settings.load->I_load[8], 3e-3);
  ASSERT_TRUE(left.settings.NE_T_EE);
  // A quarter turn about z takes x to y; columns first.
  EXPECT_NEAR(left.settings.NE_T_EE->NE_T_EE[1], 1, 1e-12);
  EXPECT_EQ(left.settings.NE_T_EE->NE_T_EE[14], 0.2);
  ASSERT_TRUE(left.settings.collision_behavior);
  EXPECT_EQ(left.settings.collision_behavior->upper_torque_thresholds_acceleration[6], 70);
  EXPECT_EQ(left.settings.collision_behavior->lower_force_thresholds_nominal[5], 6);
  EXPECT_EQ(config.arms[1].model, "auto");
  EXPECT_TRUE(config.arms[1].gripper);
  EXPECT_FALSE(config.arms[1].settings.load);
  EXPECT_EQ(config.arms[1].recovery.errors, Policy::ITSELF);
  EXPECT_EQ(config.arms[1].recovery.collisions, Policy::ASK);
  EXPECT_EQ(config.arms[1].recovery.user_stop, Policy::ASK);
  EXPECT_EQ(config.arms[1].settings.collision_behavior, robot::kCollisionBehavior);
}

TEST(Config, OfOneRobotIsReadAsAFileIs) {
  const Config config = parse_config(config_of_robot("10.0.0.\"5", false), "command line");
  ASSERT_EQ(config.arms.size(), 1u);
  EXPECT_EQ(config.arms[0].address, "10.0.0.\"5");
  EXPECT_FALSE(config.arms[0].gripper);
}

TEST(Config, WallsAreOfTheirArm) {
  const Config config = parse_config(kArm + "[[arm.wall]]\nname = 'table'\nshape = 'box'\nsize = [1, 1, 0.1]\nposition = [0.5, 0, -0.05]\n"
                                            "[[arm.wall]]\nname = 'tool'\nshape = 'capsule'\nradius = 0.02\nlength = 0\nheld = true\n"
                                            "[[arm.wall]]\nname = 'floor'\nshape = 'plane'\n"
                                            "[[arm.wall]]\nname = 'ball'\nshape = 'sphere'\nradius = 0.1\n"
                                            "[[arm.wall]]\nname = 'post'\nshape = 'cylinder'\nradius = 0.1\nlength = 1\n"
                                            "[[arm.wall]]\nname = 'wedge'\nshape = 'mesh'\n"
                                            "corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
                                            "triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]\n",
                                     "arms.toml");
  ASSERT_EQ(config.arms[0].walls.size(), 6u);
  const auto& table = config.arms[0].walls[0];
  EXPECT_EQ(table.name(), "table");
  EXPECT_EQ(table.box().size(2), 0.1);
  EXPECT_EQ(table.position(0), 0.5);
  EXPECT_EQ(table.orientation(0), 1);
  EXPECT_TRUE(config.arms[0].walls[1].held());
  EXPECT_TRUE(config.arms[0].walls[2].has_plane());
  EXPECT_EQ(config.arms[0].walls[3].sphere().radius(), 0.1);
  EXPECT_EQ(config.arms[0].walls[4].cylinder().length(), 1);
  EXPECT_EQ(config.arms[0].walls[5].mesh().corners_size(), 12);
  EXPECT_EQ(config.arms[0].walls[5].mesh().triangles_size(), 12);
}

struct Bad {
  std::string toml;
  std::string error;  // how it begins
};

TEST(Config, EachErrorSaysWhereWhatAndWhatElse) {
  const std::vector<Bad> bad = {
      {"", "arms.toml:1: arm is missing: expected at least one [[arm]]"},
      {"a = [1,", "arms.toml:1: not TOML: "},
      {"[arm]\nname='x'\n", "arms.toml:1: arm: expected one [[arm]] (in double brackets)"},
      {"arms = 1\n" + kArm, "arms.toml:1: unknown key arms; known are server, keys, recordings, load, arm"},
      {"[keys]\n" + kArm, "arms.toml:1: keys.folder is missing: expected the folder that `frankapy keys new` has made"},
      {"[keys]\nfolder = 3\n" + kArm, "arms.toml:2: keys.folder = 3: expected the folder"},
      {"[server]\nprot = 3\n" + kArm, "arms.toml:2: unknown key server.prot; known are listen, port"},
      {"[server]\nport = 65536\n" + kArm, "arms.toml:2: server.port = 65536: expected a whole number, 0 to 65535"},
      {"[server]\nport = 80.5\n" + kArm, "arms.toml:2: server.port = 80.5: expected a whole number"},
      {kArm + "processor = 1.5\n", "arms.toml:4: arm.processor = 1.5: expected the number of a processor"},
      {kArm + "lockstep = 1\n", "arms.toml:4: arm.lockstep = 1: expected true or false"},
      {kArm + "processor = -1\n", "arms.toml:4: arm.processor = -1: expected the number of a processor"},
      {"[server]\nlisten = 'everywhere'\n" + kArm, "arms.toml:2: server.listen = 'everywhere': expected an IPv4"},
      {"[[arm]]\naddress='a'\n", "arms.toml:1: arm.name is missing: expected a name"},
      {"[[arm]]\nname='a'\n", "arms.toml:1: arm.address is missing: expected the robot's address"},
      {"[[arm]]\nname='a b'\naddress='a'\n", "arms.toml:2: arm.name = 'a b': expected a name of letters"},
      {"[[arm]]\nname=7\naddress='a'\n", "arms.toml:2: arm.name = 7: expected a name"},
      {kArm + "model = 'panda'\n", "arms.toml:4: arm.model = 'panda': expected one of \"auto\", \"fer\""},
      {kArm + "gripper = 1\n", "arms.toml:4: arm.gripper = 1: expected true or false"},
      {kArm + "hold_time = -1\n", "arms.toml:4: arm.hold_time = -1: expected 0 to 3600 s"},
      {kArm + "hold_time = nan\n", "arms.toml:4: arm.hold_time = nan: expected 0 to 3600 s"},
      {kArm + "load = 2\n", "arms.toml:4: arm.load = 2: expected a table"},
      {kArm + "wall = 2\n", "arms.toml:4: arm.wall: expected one [[arm.wall]] for each wall"},
      {kArm + "[[arm.wall]]\nshape = 'plane'\n", "arms.toml:4: arm.wall.name is missing"},
      {kArm + "[[arm.wall]]\nname = 'a'\nshape = 'cone'\n", "arms.toml:6: arm.wall.shape = 'cone': expected \"plane\", \"box\""},
      {kArm + "[[arm.wall]]\nname = 'a'\nshape = 'sphere'\nradius = 0\n", "arms.toml:7: arm.wall.radius = 0: expected 0.001 to 10 m"},
      {kArm + "[[arm.wall]]\nname = 'a'\nshape = 'mesh'\ncorners = [[0, 0, 0], [1, 0]]\ntriangles = []\n",
       "arms.toml:7: arm.wall.corners = [ 1, 0 ]: expected 3 numbers x, y, z"},
      {kArm + "[[arm.wall]]\nname = 'a'\nshape = 'mesh'\ncorners = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\ntriangles = [[0, 1, 2]]\n",
       "arms.toml:4: Wall \"a\" is not closed"},
      {kArm + "[[arm.wall]]\nname = 'a'\nshape = 'mesh'\ncorners = [[0, 0, 0]]\ntriangles = [[0, 1, 2.5]]\n",
       "arms.toml:8: arm.wall.triangles = [ [ 0, 1, 2.5 ] ]: expected whole numbers of corners"},
      {kArm + "[[arm.wall]]\nname = 'a'\nshape = 'box'\nsize = [1, nan, 1]\n", "arms.toml:7: arm.wall.size[1] = nan: expected edges"},
      {kArm + "[[arm.wall]]\nname = 'a'\nshape = 'plane'\n[[arm.wall]]\nname = 'a'\nshape = 'plane'\n",
       "arms.toml:7: arm.wall.name = 'a': another wall has this name"},
      {kArm + many_walls(65), "arms.toml:4: arm.wall: there would be 65 walls: expected at most 64"},
      {kArm + "[arm.load]\nmas = 2\n", "arms.toml:4: arm.load.mass is missing: expected kg"},
      {kArm + "[arm.load]\nmass = 200\n", "arms.toml:5: arm.load.mass = 200: expected 0 to 20 kg"},
      {kArm + "[arm.load]\nmass = 1\ncenter_of_mass = [0, 0]\n", "arms.toml:6: arm.load.center_of_mass = [ 0, 0 ]: expected 3"},
      {kArm + "[arm.load]\nmass = 1\ncenter_of_mass = [0, inf, 0]\n", "arms.toml:6: arm.load.center_of_mass[1] = inf: expected"},
      {kArm + "[arm.load]\nmass = 1\ninertia = [1,0,0,0,1,0,0.5,0,1]\n", "arms.toml:6: arm.load.inertia = "},
      {kArm + "[arm.load]\nmass = 1\ninertia = [-1,0,0,0,1,0,0,0,1]\n", "arms.toml:6: arm.load.inertia = "},
      {kArm + "[arm.tool]\nquaternion = [1, 1, 0, 0]\n", "arms.toml:5: arm.tool.quaternion = [ 1, 1, 0, 0 ]: expected 4"},
      {kArm + "[arm.limits]\nvelocity = 1.5\n", "arms.toml:5: arm.limits.velocity = 1.5: expected a factor, 0.01 to 1"},
      {kArm + "[arm.limits]\npower = 0\n", "arms.toml:5: arm.limits.power = 0: expected 1 to 10000 W"},
      {kArm + "[arm.limits]\nspeed = 1\n", "arms.toml:5: unknown key arm.limits.speed; known are velocity"},
      {kArm + "[arm.recovery]\nerrors = 3\n", "arms.toml:5: arm.recovery.errors = 3: expected \"itself\", \"ask\" or \"never\""},
      {kArm + "[arm.recovery]\nuser_stop = \"never\"\n", "arms.toml:5: arm.recovery.user_stop = 'never': expected \"itself\" or \"ask\""},
      {kArm + "[arm.recovery]\ntimes = 0\n", "arms.toml:5: arm.recovery.times = 0: expected a whole number, 1 to 1000"},
      {kArm + "[arm.collision]\n", "arms.toml:4: arm.collision.lower_torque_thresholds is missing"},
      {kArm + kArm, "arms.toml:4: arm.name = 'left': another arm has this name"},
      {kArm + "[[arm]]\nname='b'\naddress='172.16.0.2'\n", "arms.toml:4: arm.address = '172.16.0.2': another arm"},
  };
  for (const auto& [toml, error] : bad) EXPECT_TRUE(error_of(toml).starts_with(error)) << toml << "\n" << error_of(toml);
}

TEST(Config, LowerThresholdsAreNotAboveTheUpperOnes) {
  const std::string text = error_of(kArm + R"([arm.collision]
lower_torque_thresholds = [1, 2, 31, 4, 5, 6, 7]
upper_torque_thresholds = [10, 20, 30, 40, 50, 60, 70]
lower_force_thresholds = [1, 2, 3, 4, 5, 6]
upper_force_thresholds = [10, 20, 30, 40, 50, 60]
)");
  EXPECT_EQ(text, "arms.toml:4: arm.collision.lower_torque_thresholds[2] = 31: expected at most the upper one, 30");
}

TEST(Config, TheExampleIsOne) {
  const std::string file = REPOSITORY_DIR "/examples/arms.toml";
  const Config config = parse_config(read_config_file(file), file);
  ASSERT_EQ(config.arms.size(), 2u);
  EXPECT_EQ(config.arms[0].processor, 3);
  EXPECT_EQ(config.arms[0].settings.collision_behavior, config.arms[1].settings.collision_behavior) << "which names the defaults";
}

TEST(Config, AFileThatCannotBeReadIsNamed) {
  EXPECT_THROW(read_config_file("/nowhere/arms.toml"), ConfigError);
  EXPECT_THROW(read_config_file("/tmp"), ConfigError);
  EXPECT_THROW(read_config_file("/dev/zero"), ConfigError) << "which does not end";
}

TEST(Config, NamesLibrariesOfParts) {
  EXPECT_TRUE(parse_config(kArm, "arms.toml").load.empty());
  const std::vector<std::string> expected = {"a.so", "/b/c.so"};
  EXPECT_EQ(parse_config("load = ['a.so', '/b/c.so']\n" + kArm, "arms.toml").load, expected);
  EXPECT_NE(error_of("load = 'a.so'\n" + kArm).find("arms.toml:1: load = 'a.so': expected a list of libraries"),
            std::string::npos)
      << error_of("load = 'a.so'\n" + kArm);
  EXPECT_NE(error_of("load = [3]\n" + kArm).find("expected a list of libraries"), std::string::npos);
}

}  // namespace
}  // namespace server
