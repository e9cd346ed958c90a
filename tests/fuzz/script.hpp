#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace fuzz {

// An input is a list of steps: what to do (one byte), how much of it (two, little-endian), and that many bytes to do it
// with. Whatever the fuzzer makes is such a list: lengths are cut at the end.
class Script {
 public:
  Script(const std::uint8_t* data, std::size_t size) : rest_(reinterpret_cast<const std::byte*>(data), size) {}

  // False at the end.
  bool next(int& what, std::span<const std::byte>& bytes) {
    if (rest_.size() < 3) return false;
    what = std::to_integer<int>(rest_[0]);
    std::size_t size = std::to_integer<std::size_t>(rest_[1]) | std::to_integer<std::size_t>(rest_[2]) << 8;
    rest_ = rest_.subspan(3);
    size = size < rest_.size() ? size : rest_.size();
    bytes = rest_.first(size);
    rest_ = rest_.subspan(size);
    return true;
  }

 private:
  std::span<const std::byte> rest_;
};

}  // namespace fuzz
