#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace server {

// Which part an arm's process is in at this moment. It lies in memory that the supervisor shares, so that a part can still
// be named when the process has ended in it.
class PartRecord {
 public:
  std::atomic<std::uint32_t> in_loop{0};     // number of the part's kind (server/registry.hpp); 0: in none
  std::atomic<std::uint32_t> in_builder{0};  // likewise, while a skill is made and looked at

  // What to call the kinds, in the order of their numbers.
  void describe(const std::vector<std::string>& names);
  // Of the next process.
  void clear();

  // " in the controller Lqr"; empty: in none.
  std::string where() const;

 private:
  std::array<std::array<char, 120>, 256> names_{};
};

// This process's own, until it is told to use another.
PartRecord& part_record();
void use(std::shared_ptr<PartRecord> record);

// Memory for one that a child may inherit, and this process's look at such memory. They throw std::system_error.
int make_part_record_file();
std::shared_ptr<PartRecord> map_part_record(int fd);

// While it lives, the builder is in a part of that number.
class InPart {
 public:
  explicit InPart(std::uint32_t number) : before_(part_record().in_builder.exchange(number)) {}
  ~InPart() { part_record().in_builder = before_; }
  InPart(const InPart&) = delete;

 private:
  std::uint32_t before_;
};

}  // namespace server
