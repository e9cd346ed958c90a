#pragma once

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <random>
#include <stdexcept>
#include <string>

namespace testing_tools {

inline bool is_free(const std::string& address, std::uint16_t port) {
  sockaddr_in own{};
  own.sin_family = AF_INET;
  own.sin_port = htons(port);
  ::inet_pton(AF_INET, address.c_str(), &own.sin_addr);
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  const bool bound = ::bind(fd, reinterpret_cast<sockaddr*>(&own), sizeof own) == 0;
  ::close(fd);
  return bound;
}

// A loopback address on which nobody has a robot's ports.
inline std::string free_address() {
  static std::mt19937 random{std::random_device{}()};
  std::uniform_int_distribution<> part(1, 254);
  for (int attempt = 0; attempt < 100; ++attempt) {
    const std::string address =
        "127." + std::to_string(part(random)) + "." + std::to_string(part(random)) + "." + std::to_string(part(random));
    if (is_free(address, 1337) && is_free(address, 1338)) return address;
  }
  throw std::runtime_error("ports 1337 and 1338 are taken at all of 100 loopback addresses: end what listens on them at 0.0.0.0");
}

}  // namespace testing_tools
