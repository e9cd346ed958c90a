#include "server/shared_memory.hpp"

#include <sys/mman.h>
#include <unistd.h>

#include "server/system_call.hpp"

namespace server {

int make_memory_file(const char* name, std::size_t size) {
  const int fd = memfd_create(name, MFD_CLOEXEC);
  if (fd < 0 || ftruncate(fd, static_cast<off_t>(size)) != 0) failed("memfd_create");
  return fd;
}

std::shared_ptr<void> map_memory(int fd, std::size_t size) {
  const int flags = MAP_POPULATE | (fd < 0 ? MAP_PRIVATE | MAP_ANONYMOUS : MAP_SHARED);
  void* memory = mmap(nullptr, size, PROT_READ | PROT_WRITE, flags, fd, 0);
  if (memory == MAP_FAILED) failed("mmap");
  return {memory, [size](void* at) { munmap(at, size); }};
}

}  // namespace server
