#include "sim/world/truth_file.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tests/sim/arm_rig.hpp"

namespace sim {
namespace {

class TruthFileTest : public testing::Test {
 protected:
  TruthFileTest() {
    options.arm = &models::arm("fr3");
    options.scene = REPOSITORY_DIR "/sim/scenes/table_with_block.xml";
  }
  ~TruthFileTest() override {
    for (const std::string& path : paths_) std::filesystem::remove(path);
  }

  std::string path(const std::string& name) {
    return paths_.emplace_back(testing::TempDir() + "truth_" + std::to_string(getpid()) + "_" + name + ".npy");
  }
  static std::string bytes(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::stringstream all;
    all << file.rdbuf();
    return all.str();
  }
  // What NumPy makes of the file.
  static std::string numpy(const std::string& path, const std::string& expression) {
    const std::string command = PYTHON " -c \"import numpy as np; a = np.load('" + path + "'); print(" + expression + ")\" 2>&1";
    std::FILE* pipe = popen(command.c_str(), "r");
    char text[4000] = "";
    const std::size_t n = std::fread(text, 1, sizeof text - 1, pipe);
    pclose(pipe);
    return std::string(text, n);
  }

  World::Options options;

 private:
  std::vector<std::string> paths_;
};

TEST_F(TruthFileTest, IsWhatNumpyLoads) {
  ArmRig rig(options);
  const std::string file = path("loads");
  {
    TruthFile truth(file, rig.world);
    for (int i = 0; i < 250; ++i) {
      rig.cycle();
      truth.append(rig.world, 0, 1000 + i, i >= 100);
    }
  }
  EXPECT_EQ(numpy(file, "a.shape, a['cycle'][-1], a['moving'].sum(), a['q'].shape, a['O_T_TCP'].shape, "
                        "a['object_block'].shape, a['qpos'].shape"),
            "(250,) 1249 150 (250, 7) (250, 16) (250, 7) (250, 16)\n");
  char expected[200];
  std::snprintf(expected, sizeof expected, "%.17g %.17g %.17g\n", rig.world.truth().time, rig.world.truth().q[3],
                rig.world.object_pose(0)[1]);
  EXPECT_EQ(numpy(file, "'%.17g %.17g %.17g' % (a['time'][-1], a['q'][-1, 3], a['object_block'][-1, 1])"), expected);
}

TEST_F(TruthFileTest, CanBeReadWhileItIsWritten) {
  ArmRig rig(options);
  const std::string file = path("written");
  TruthFile truth(file, rig.world);
  EXPECT_EQ(numpy(file, "len(a)"), "0\n");
  for (int i = 0; i < 1050; ++i) truth.append(rig.world, 0, i, false);
  // As after a kill: what is not yet written is missing, the rest is whole.
  EXPECT_EQ(numpy(file, "len(a) > 900, list(a['cycle']) == list(range(len(a)))"), "True True\n");
}

TEST_F(TruthFileTest, SameRunsAreTheSameFile) {
  const std::string files[] = {path("first"), path("second")};
  for (const std::string& file : files) {
    ArmRig rig(options);
    TruthFile truth(file, rig.world);
    for (int i = 0; i < 300; ++i) {
      if (i == 50) rig.world.push({5, 3, -20, 0, 1, 0});
      rig.cycle();
      truth.append(rig.world, 0, i, true);
    }
  }
  EXPECT_GT(bytes(files[0]).size(), 300 * 8 * 60u);
  EXPECT_EQ(bytes(files[0]), bytes(files[1]));
}

TEST_F(TruthFileTest, SaysWhenItCannotBeWritten) {
  const World world(options);
  try {
    TruthFile("/nowhere/truth.npy", world);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/truth.npy: No such file"), std::string::npos) << error.what();
  }
  if (std::filesystem::exists("/dev/full")) {
    EXPECT_THROW(
        {
          TruthFile truth("/dev/full", world);
          for (int i = 0; i < 5000; ++i) truth.append(world, 0, i, false);
        },
        std::runtime_error);
  }
}

}  // namespace
}  // namespace sim
