#include "server/kept.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "server/system_call.hpp"

namespace server {
namespace {

// What is under way to a file, or a folder, is on the disk: also after a loss of power.
void sync(const std::filesystem::path& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) failed(path.c_str());
  const bool done = fsync(fd) == 0 || errno == EINVAL;  // some file systems have none
  const int error = errno;
  close(fd);
  errno = error;
  if (!done) failed(path.c_str());
}

}  // namespace

bool load(int fd, google::protobuf::Message& message) {
  message.Clear();
  struct stat file {};
  if (fd < 0 || fstat(fd, &file) != 0 || file.st_size == 0) return true;
  std::string bytes(static_cast<std::size_t>(file.st_size), 0);
  if (pread(fd, bytes.data(), bytes.size(), 0) == file.st_size && message.ParseFromString(bytes)) return true;
  message.Clear();
  return false;
}

bool load(const std::string& path, google::protobuf::Message& message) {
  message.Clear();
  if (path.empty() || !std::filesystem::exists(path)) return true;
  std::ifstream file(path, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(file), {});
  // Empty is what a file system may leave when the power fails.
  if (file && !bytes.empty() && message.ParseFromString(bytes)) return true;
  message.Clear();
  return false;
}

void save(int fd, const google::protobuf::Message& message) {
  if (fd < 0) return;
  const std::string bytes = message.SerializeAsString();
  if (pwrite(fd, bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) failed("pwrite");
  if (ftruncate(fd, static_cast<off_t>(bytes.size())) != 0) failed("ftruncate");
}

void save(const std::string& path, const google::protobuf::Message& message) {
  if (path.empty()) return;
  const std::filesystem::path whole = path, part = path + ".part";
  std::filesystem::create_directories(whole.parent_path());
  if (message.ByteSizeLong() == 0) {
    std::filesystem::remove(whole);
    return;
  }
  {
    std::ofstream file(part, std::ios::binary);
    file << message.SerializeAsString() << std::flush;
    if (!file) failed(part.c_str());
  }
  sync(part);
  std::filesystem::rename(part, whole);
  sync(whole.parent_path());
}

}  // namespace server
