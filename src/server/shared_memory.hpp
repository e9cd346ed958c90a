#pragma once

#include <cstddef>
#include <memory>

namespace server {

// Memory that a child inherits as an open file: `size` zero bytes. The caller closes it. Throws std::system_error.
int make_memory_file(const char* name, std::size_t size);

// Such a file's memory, or with fd -1 as many zero bytes of this process alone; all its pages at once, and none in the loop.
// Throws std::system_error.
std::shared_ptr<void> map_memory(int fd, std::size_t size);

}  // namespace server
