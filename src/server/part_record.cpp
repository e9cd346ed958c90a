#include "server/part_record.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "server/shared_memory.hpp"

namespace server {
namespace {

std::shared_ptr<PartRecord> used = std::make_shared<PartRecord>();

}  // namespace

void PartRecord::describe(const std::vector<std::string>& names) {
  for (std::size_t i = 0; i < std::min(names.size(), names_.size()); ++i) {
    auto& name = names_[i];
    name.fill(0);
    names[i].copy(name.data(), name.size() - 1);
  }
}

void PartRecord::clear() { in_loop = in_builder = 0; }

std::string PartRecord::where() const {
  std::string text;
  const auto add = [&](std::uint32_t number, const char* how) {
    if (number == 0 || number > names_.size()) return;
    const auto& name = names_[number - 1];
    text += (text.empty() ? " in the " : " or the ") + std::string(name.data(), strnlen(name.data(), name.size())) + how;
  };
  add(in_loop, "");
  add(in_builder, " as it was made or looked at");
  return text;
}

PartRecord& part_record() { return *used; }
void use(std::shared_ptr<PartRecord> record) { used = std::move(record); }

int make_part_record_file() { return make_memory_file("parts", sizeof(PartRecord)); }

std::shared_ptr<PartRecord> map_part_record(int fd) {
  return std::static_pointer_cast<PartRecord>(map_memory(fd, sizeof(PartRecord)));  // zeros are one in which nothing is
}

}  // namespace server
