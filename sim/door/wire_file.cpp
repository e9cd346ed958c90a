#include "sim/door/wire_file.hpp"

#include <fcntl.h>
#include <sys/uio.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <stdexcept>

#include "wire/fci/service.hpp"

namespace sim {
namespace {

struct FileHeader {
  std::uint32_t magic = 0xa1b23c4d;  // the writer's byte order, nanoseconds
  std::uint16_t major = 2, minor = 4;
  std::uint32_t reserved[2] = {};
  std::uint32_t longest = 65535;
  std::uint32_t link_type = 228;  // LINKTYPE_IPV4
};

// Of IPv4 (RFC 791) and UDP (RFC 768), big-endian.
struct Packet {
  std::uint32_t seconds = 0, nanoseconds = 0, captured = 0, length = 0;  // of the file
  std::uint8_t version = 0x45, service = 0;
  std::uint16_t total = 0, identification = 0, fragments = htons(0x4000);
  std::uint8_t time_to_live = 64, protocol = IPPROTO_UDP;
  std::uint16_t checksum = 0;
  in_addr from{}, to{};
  std::uint16_t from_port = 0, to_port = 0, udp_length = 0, udp_checksum = 0;
};
constexpr std::size_t kFileHeader = 24, kOfFile = 16, kIp = 20, kUdp = 8;
static_assert(sizeof(FileHeader) == kFileHeader && sizeof(Packet) == kOfFile + kIp + kUdp);

// One's complement of the sum in one's complement.
std::uint16_t checksum(const Packet& packet) {
  std::uint16_t words[kIp / 2];
  std::memcpy(words, reinterpret_cast<const std::byte*>(&packet) + kOfFile, sizeof words);
  std::uint32_t sum = 0;
  for (const std::uint16_t word : words) sum += word;
  while (sum >> 16 != 0) sum = (sum & 0xffff) + (sum >> 16);
  return static_cast<std::uint16_t>(~sum);
}

}  // namespace

WireFile::WireFile(const std::string& path, const in_addr& arm)
    : path_(path), file_(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)) {
  arm_ = {};
  arm_.sin_port = htons(fci::kRobotPort);
  arm_.sin_addr = arm;
  const FileHeader header;
  if (file_.fd() < 0 || ::write(file_.fd(), &header, sizeof header) != sizeof header) {
    throw std::runtime_error("cannot write what is on the wire to " + path + ": " + std::strerror(errno));
  }
}

void WireFile::append(const sockaddr_in& from, const sockaddr_in& to, std::span<const std::byte> datagram,
                      std::size_t size) {
  timespec now;
  ::clock_gettime(CLOCK_REALTIME, &now);
  Packet packet;
  packet.seconds = static_cast<std::uint32_t>(now.tv_sec);
  packet.nanoseconds = static_cast<std::uint32_t>(now.tv_nsec);
  packet.captured = static_cast<std::uint32_t>(kIp + kUdp + datagram.size());
  packet.length = static_cast<std::uint32_t>(kIp + kUdp + size);
  packet.total = htons(static_cast<std::uint16_t>(packet.length));
  packet.from = from.sin_addr;
  packet.to = to.sin_addr;
  packet.from_port = from.sin_port;
  packet.to_port = to.sin_port;
  packet.udp_length = htons(static_cast<std::uint16_t>(kUdp + size));
  packet.checksum = checksum(packet);
  iovec parts[] = {{&packet, sizeof packet}, {const_cast<std::byte*>(datagram.data()), datagram.size()}};
  if (::writev(file_.fd(), parts, 2) == static_cast<ssize_t>(sizeof packet + datagram.size())) return;
  throw std::runtime_error("cannot go on writing what is on the wire to " + path_ + ": " + std::strerror(errno));
}

}  // namespace sim
