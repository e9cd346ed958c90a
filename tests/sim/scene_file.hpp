#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace sim {

// A file of this test's own, gone afterwards.
class SceneFile {
 public:
  explicit SceneFile(const std::string& text)
      : path_(std::filesystem::path(testing::TempDir()) / ("scene-" + std::to_string(::getpid()) + ".xml")) {
    std::ofstream(path_) << text;
  }
  ~SceneFile() { std::filesystem::remove(path_); }
  std::string path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace sim
