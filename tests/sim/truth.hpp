#pragma once

#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace testing_tools {

// The first columns of the truth file, which is a NumPy array of rows.
struct TruthRow {
  std::uint64_t cycle = 0, moving = 0;
  double time = 0;
  double q[7] = {};
};

// The bytes of each row of a truth file.
inline std::vector<std::string> read_rows(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(file), {}};
  std::uint16_t header = 0;
  std::memcpy(&header, bytes.data() + 8, sizeof header);
  const std::string description = bytes.substr(10, header);
  const std::size_t count = std::stoul(description.substr(description.find("'shape': (") + 10));
  const std::size_t row_size = count == 0 ? 0 : (bytes.size() - 10 - header) / count;
  std::vector<std::string> rows;
  for (std::size_t i = 0; i < count; ++i) rows.push_back(bytes.substr(10 + header + i * row_size, row_size));
  return rows;
}

inline std::vector<TruthRow> read_truth(const std::string& path) {
  std::vector<TruthRow> rows;
  for (const std::string& row : read_rows(path)) std::memcpy(&rows.emplace_back(), row.data(), sizeof(TruthRow));
  return rows;
}

}  // namespace testing_tools
