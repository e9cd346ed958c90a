#include "server/black_box.hpp"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <climits>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <utility>

#include "server/clocks.hpp"
#include "server/part.hpp"
#include "server/shared_memory.hpp"

namespace server {
namespace {

constexpr std::size_t kPage = 4096;
constexpr std::size_t kMostLeft = 8;  // files of some 40 MB, those of arms that run among them

constexpr std::size_t whole_pages(std::size_t size) { return (size + kPage - 1) / kPage * kPage; }

std::size_t journal_size() { return whole_pages(Journal::size()); }
std::size_t records_size() { return whole_pages(bridge::Ring<realtime::Record>::size(BlackBox::kRecords)); }

// Whose it is, behind all else: pages of a file that are not mapped.
struct Label {
  char layout[1024];  // of the memory, by the build that made it
  char arm[256];
  char folder[PATH_MAX];
  double max_gb;
};

std::size_t label_place() { return journal_size() + records_size(); }
std::size_t file_size() { return label_place() + whole_pages(sizeof(Label)); }

constexpr std::string_view kName = "franka-interface-";

std::string layout() { return fmt::format("{} {} {}", sizeof(realtime::Record), label_place(), abi()); }

template <std::size_t size>
void put(char (&to)[size], const std::string& text) {
  text.copy(to, size - 1);
}
template <std::size_t size>
std::string text_of(const char (&from)[size]) {
  return {from, strnlen(from, size)};
}

// Memory of the journal, then of the records, which share its life.
std::pair<std::shared_ptr<void>, std::shared_ptr<void>> map(int fd) {
  const std::shared_ptr<void> all = map_memory(fd, journal_size() + records_size());
  return {all, std::shared_ptr<void>(all, static_cast<std::byte*>(all.get()) + journal_size())};
}

// Of a file that has a name, or gets it when all is in it; -1 where there is no room.
int make_named_file(const BlackBoxOwner& owner) {
  const int fd = open(black_box_folder().c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (fd < 0) return -1;
  Label label{};
  put(label.layout, layout());
  put(label.arm, owner.arm);
  put(label.folder, owner.folder);
  label.max_gb = owner.max_gb;
  const std::string name = fmt::format("{}/{}{}-{:x}", black_box_folder(), kName, geteuid(), clock_ns(CLOCK_REALTIME));
  // Room for all of it now: a page that is missing later would end the process.
  if (posix_fallocate(fd, 0, static_cast<off_t>(file_size())) != 0 || flock(fd, LOCK_EX | LOCK_NB) != 0 ||
      pwrite(fd, &label, sizeof label, static_cast<off_t>(label_place())) != sizeof label ||
      linkat(AT_FDCWD, fmt::format("/proc/self/fd/{}", fd).c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) != 0) {
    close(fd);
    return -1;
  }
  return fd;
}

// What this user's black boxes are called.
std::vector<std::filesystem::path> names() {
  std::vector<std::filesystem::path> names;
  std::error_code none;
  const std::string own = fmt::format("{}{}-", kName, geteuid());
  for (const auto& entry : std::filesystem::directory_iterator(black_box_folder(), none)) {
    if (entry.path().filename().string().starts_with(own)) names.push_back(entry.path());
  }
  return names;
}

}  // namespace

std::string black_box_folder() {
  const char* folder = std::getenv("FRANKA_INTERFACE_BLACK_BOXES");
  return folder != nullptr && *folder != '\0' ? folder : "/dev/shm";
}

BlackBox::BlackBox(bridge::Ring<realtime::Record> of_records, Journal of_journal)
    : records(std::move(of_records)), journal(std::move(of_journal)) {}

BlackBox::BlackBox(std::shared_ptr<void> journal_memory, std::shared_ptr<void> records_memory)
    : records(std::move(records_memory), kRecords), journal(std::move(journal_memory)) {}

BlackBox::BlackBox() : BlackBox(in(-1)) {}

BlackBox BlackBox::in(int fd) {
  auto [journal, records] = map(fd);
  return BlackBox(std::move(journal), std::move(records));
}

std::unique_ptr<BlackBox> BlackBox::found(int fd) {
  auto [journal, records] = map(fd);
  std::unique_ptr<BlackBox> box(new BlackBox(bridge::Ring<realtime::Record>::found(std::move(records), kRecords),
                                             Journal::found(std::move(journal))));
  return box->records.written() == 0 ? nullptr : std::move(box);
}

int make_black_box_file(const std::optional<BlackBoxOwner>& owner) {
  const int named = owner ? make_named_file(*owner) : -1;
  return named >= 0 ? named : make_memory_file("black box", file_size());
}

void forget_black_box(int fd) {
  struct stat file {}, named {};
  if (fstat(fd, &file) != 0 || file.st_nlink == 0) return;
  // A file that got its name later does not know it.
  for (const auto& name : names()) {
    if (lstat(name.c_str(), &named) == 0 && named.st_ino == file.st_ino && named.st_dev == file.st_dev) unlink(name.c_str());
  }
}

std::string leave_black_box(int fd) {
  struct stat file {};
  if (fstat(fd, &file) == 0 && file.st_nlink > 0 && names().size() <= kMostLeft) {
    return "The next start of this program tries again, as long as this computer has power";
  }
  forget_black_box(fd);
  return "It is gone";
}

std::vector<LeftBlackBox> left_black_boxes() {
  std::vector<LeftBlackBox> left;
  for (const auto& name : names()) {
    const int fd = open(name.c_str(), O_RDWR | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) continue;
    // Another user may have made it, and another server may have taken it since it was opened.
    struct stat file {};
    Label label{};
    if (fstat(fd, &file) != 0 || !S_ISREG(file.st_mode) || file.st_uid != geteuid() || flock(fd, LOCK_EX | LOCK_NB) != 0 ||
        fstat(fd, &file) != 0 || file.st_nlink == 0) {
      close(fd);
    } else if (pread(fd, &label, sizeof label, static_cast<off_t>(label_place())) != sizeof label ||
               static_cast<std::size_t>(file.st_size) != file_size() || text_of(label.layout) != layout()) {
      spdlog::warn("{} was left by another build of this program, which alone could read it: it is removed", name.string());
      forget_black_box(fd);
      close(fd);
    } else {
      left.push_back({fd, {text_of(label.arm), text_of(label.folder), label.max_gb}});
    }
  }
  return left;
}

}  // namespace server
