#pragma once

#include <netinet/in.h>

#include <cstddef>
#include <span>
#include <string>

#include "sim/door/connection.hpp"

namespace sim {

// The datagrams of one arm as they are on the wire, states and commands, as a file of Wireshark and tcpdump (pcap with nanoseconds,
// packets of IPv4; draft-ietf-opsawg-pcap). Commands are there as they came, also those that the arm's own network then loses. Each
// is in the file before the arm goes on. The file may be a pipe, which the arm then waits for.
class WireFile {
 public:
  // Throws std::runtime_error when the file cannot be written.
  WireFile(const std::string& path, const in_addr& arm);

  // Whose datagrams these are from now on.
  void set_client(const sockaddr_in& client) { client_ = client; }

  // Throw std::runtime_error when the disk takes no more. Of a command of so many bytes (less than 64 kB) only the first may be here.
  void sent(std::span<const std::byte> state) { append(arm_, client_, state, state.size()); }
  void received(std::span<const std::byte> first, std::size_t size) { append(client_, arm_, first, size); }

 private:
  void append(const sockaddr_in& from, const sockaddr_in& to, std::span<const std::byte> datagram, std::size_t size);

  std::string path_;
  File file_;
  sockaddr_in arm_, client_{};
};

}  // namespace sim
