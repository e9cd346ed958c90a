#include "server/kept.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <string>

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

void save(int fd, const google::protobuf::Message& message) {
  if (fd < 0) return;
  const std::string bytes = message.SerializeAsString();
  if (pwrite(fd, bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) failed("pwrite");
  if (ftruncate(fd, static_cast<off_t>(bytes.size())) != 0) failed("ftruncate");
}

}  // namespace server
