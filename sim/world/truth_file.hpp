#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "sim/world/world.hpp"

namespace sim {

// What really happened, one row a cycle of the world, as a NumPy file: `numpy.load(path)` gives a structured array
// with the fields cycle (the message_id of the state that it led to, where the world never stood still), moving, time,
// q, dq, ddq, tau_motor, tau_J, finger, finger_force, O_T_TCP, contact_wrench, push, one field object_NAME (position,
// quaternion w x y z) for each body of the scene that moves, and qpos as MuJoCo has it; of objects that were added later
// nothing. The number of rows in its header is brought up to date every 0.1 s and at
// the end, so the file can be read at any time, also after its writer was killed.
class TruthFile {
 public:
  // Throws std::runtime_error when the file cannot be written.
  TruthFile(const std::string& path, const World& world);
  ~TruthFile();
  TruthFile(const TruthFile&) = delete;

  // One cycle; `moving` is whether a motion of the robot was active. Throws std::runtime_error when the disk takes no more.
  void append(const World& world, std::size_t arm, std::uint64_t cycle, bool moving);

 private:
  void write_header();
  void flush();

  std::string path_;
  std::FILE* file_ = nullptr;
  std::string fields_;           // of the dtype, as Python source
  std::size_t header_size_ = 0;  // bytes
  std::uint64_t rows_ = 0, rows_written_ = 0;
  std::size_t objects_ = 0, nq_ = 0;
  std::vector<double> buffer_;
};

}  // namespace sim
