#include "sim/world/truth_file.hpp"

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace sim {
namespace {

constexpr std::uint64_t kRowsPerFlush = 100;  // some 80 kB: short enough to write within a cycle
constexpr std::size_t kCountWidth = 20;  // digits kept free for the number of rows

}  // namespace

TruthFile::TruthFile(const std::string& path, const World& world) : path_(path) {
  file_ = std::fopen(path.c_str(), "wb");
  if (file_ == nullptr) {
    throw std::runtime_error("cannot write the truth file " + path + ": " + std::strerror(errno));
  }
  const auto field = [this](const std::string& name, const char* type, std::size_t count) {
    fields_ += "('" + name + "', '" + type + "'" +
               (count == 1 ? "" : ", (" + std::to_string(count) + ",)") + "), ";
  };
  field("cycle", "<u8", 1);
  field("moving", "<u8", 1);
  field("time", "<f8", 1);
  for (const char* name : {"q", "dq", "ddq", "tau_motor", "tau_J"}) field(name, "<f8", 7);
  field("finger", "<f8", 2);
  field("finger_force", "<f8", 2);
  field("O_T_TCP", "<f8", 16);
  field("contact_wrench", "<f8", 6);
  field("push", "<f8", 6);
  for (const std::string& name : world.objects()) field("object_" + name, "<f8", 7);
  objects_ = world.objects().size();
  nq_ = world.qpos().size();
  field("qpos", "<f8", nq_);
  write_header();
  std::fflush(file_);
}

TruthFile::~TruthFile() {
  flush();
  std::fclose(file_);
}

// Format 1.0 of numpy.lib.format: magic, length of the header, header padded to 64 bytes.
void TruthFile::write_header() {
  std::string count = std::to_string(rows_written_);
  count.resize(kCountWidth, ' ');
  std::string header = "{'descr': [" + fields_ + "], 'fortran_order': False, 'shape': (" + count + ",), }";
  constexpr std::size_t kPrefix = 10;
  header.resize((kPrefix + header.size() + 1 + 63) / 64 * 64 - kPrefix - 1, ' ');
  header += '\n';
  const auto size = static_cast<std::uint16_t>(header.size());
  std::fseek(file_, 0, SEEK_SET);
  std::fwrite("\x93NUMPY\x01\x00", 1, 8, file_);
  std::fwrite(&size, sizeof size, 1, file_);
  std::fwrite(header.data(), 1, header.size(), file_);
  header_size_ = kPrefix + header.size();
}

void TruthFile::append(const World& world, std::size_t arm, std::uint64_t cycle, bool moving) {
  const auto put = [this](const auto& values) { buffer_.insert(buffer_.end(), values.begin(), values.end()); };
  const auto put_integer = [this](std::uint64_t value) {
    double bits;
    std::memcpy(&bits, &value, sizeof bits);
    buffer_.push_back(bits);
  };
  const Truth& truth = world.truth(arm);
  put_integer(cycle);
  put_integer(moving);
  buffer_.push_back(truth.time);
  put(truth.q);
  put(truth.dq);
  put(truth.ddq);
  put(truth.tau_motor);
  put(truth.tau_J);
  put(truth.finger);
  put(truth.finger_force);
  put(truth.O_T_TCP);
  put(truth.contact_wrench);
  put(truth.push);
  for (std::size_t i = 0; i < objects_; ++i) put(world.object_pose(i, arm));
  put(world.qpos().first(nq_));
  if (++rows_ % kRowsPerFlush == 0) {
    flush();
    if (std::ferror(file_)) {
      throw std::runtime_error("cannot go on writing the truth file " + path_ + " after " + std::to_string(rows_) +
                               " cycles: " + std::strerror(errno));
    }
  }
}

void TruthFile::flush() {
  std::fseek(file_, 0, SEEK_END);
  std::fwrite(buffer_.data(), sizeof(double), buffer_.size(), file_);
  std::fflush(file_);  // rows before the count that promises them
  buffer_.clear();
  rows_written_ = rows_;
  write_header();
  std::fflush(file_);
}

}  // namespace sim
