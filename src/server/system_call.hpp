#pragma once

#include <cerrno>
#include <system_error>

namespace server {

// Throws what errno says of the system call `what`.
[[noreturn]] inline void failed(const char* what) { throw std::system_error(errno, std::generic_category(), what); }

}  // namespace server
