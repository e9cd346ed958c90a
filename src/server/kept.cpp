#include "server/kept.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "server/system_call.hpp"

namespace server {

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
  std::filesystem::rename(part, whole);
}

}  // namespace server
