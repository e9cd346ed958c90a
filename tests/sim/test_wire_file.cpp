#include "sim/door/wire_file.hpp"

#include <filesystem>
#include <fstream>
#include <iterator>

#include "raw_client.hpp"

namespace {

using namespace testing_tools;

// Numbers of a file's header in this computer's byte order, and of IPv4 and UDP in the network's.
template <class T>
T number(const std::string& bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}
std::uint16_t network(const std::string& bytes, std::size_t at) { return ntohs(number<std::uint16_t>(bytes, at)); }

struct Datagram {
  std::string from, to;  // address:port
  std::string payload;
};

std::string place(const std::string& bytes, std::size_t address, std::size_t port) {
  return sim::text(number<in_addr>(bytes, address)) + ":" + std::to_string(network(bytes, port));
}

// What RFC 791, RFC 768 and the draft of pcap say that it holds.
std::vector<Datagram> datagrams(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(stream), {}};
  EXPECT_EQ(number<std::uint32_t>(bytes, 0), 0xa1b23c4du);
  EXPECT_EQ(number<std::uint16_t>(bytes, 4), 2);
  EXPECT_EQ(number<std::uint32_t>(bytes, 20), 228u);
  std::vector<Datagram> found;
  for (std::size_t at = 24; at < bytes.size();) {
    const auto length = number<std::uint32_t>(bytes, at + 8);
    EXPECT_EQ(number<std::uint32_t>(bytes, at + 12), length);
    EXPECT_LT(number<std::uint32_t>(bytes, at + 4), 1'000'000'000u);
    const std::size_t ip = at + 16, udp = ip + 20;
    EXPECT_EQ(bytes[ip], 0x45);
    EXPECT_EQ(bytes[ip + 9], 17);
    EXPECT_EQ(network(bytes, ip + 2), length);
    EXPECT_EQ(network(bytes, udp + 4), length - 20);
    std::uint32_t sum = 0;
    for (std::size_t k = 0; k < 20; k += 2) sum += network(bytes, ip + k);
    EXPECT_EQ((sum & 0xffff) + (sum >> 16), 0xffffu);
    found.push_back({place(bytes, ip + 12, udp), place(bytes, ip + 16, udp + 2), bytes.substr(udp + 8, length - 28)});
    at += 16 + length;
  }
  return found;
}

TEST(WireFile, HasEachStateAndCommandAsItIsOnTheWire) {
  const std::string file = testing::TempDir() + "wire_" + std::to_string(::getpid()) + ".pcap";
  std::vector<std::uint64_t> sent, received;
  std::string arm_at, client_at;
  {
    auto options = lockstep();
    options.arms = {{.model = nullptr, .address = {}, .truth = {}, .wire = file}};
    DrivenArm arm("fr3", options);
    RawClient client(arm, 10);
    arm_at = arm.address() + ":1337";
    client_at = "127.0.0.1:" + std::to_string(client.sockets.udp_port());
    client.start({.motion_generator_mode = fci::MotionGeneratorMode::kJointPosition});
    for (int i = 0; i < 20; ++i) {
      sent.push_back(client.state.message_id);
      client.send(client.hold());
      received.push_back(client.receive().message_id);
    }
    client.sockets.send_datagram(std::as_bytes(std::span("what is no command", 18)));
    client.send(client.hold());
    client.receive();
  }
  std::vector<std::uint64_t> commands, states;
  std::vector<std::string> others;
  for (const Datagram& datagram : datagrams(file)) {
    const bool state = datagram.from == arm_at;
    EXPECT_EQ(datagram.from, state ? arm_at : client_at);
    EXPECT_EQ(datagram.to, state ? client_at : arm_at);
    const std::size_t size = state ? fci::size_of<fci::RobotState>(10) : fci::size_of<fci::RobotCommand>(10);
    if (datagram.payload.size() == size) {
      (state ? states : commands).push_back(number<std::uint64_t>(datagram.payload, 0));
    } else {
      others.push_back(datagram.payload);
    }
  }
  ASSERT_EQ(commands.size(), sent.size() + 1);
  EXPECT_TRUE(std::equal(sent.begin(), sent.end(), commands.begin()));
  EXPECT_TRUE(std::equal(received.rbegin(), received.rend(), states.rbegin() + 1));
  EXPECT_EQ(others, std::vector<std::string>{"what is no command"});
  std::filesystem::remove(file);
}

TEST(WireFile, SaysWhenItCannotBeWritten) {
  try {
    sim::WireFile("/nowhere/run.pcap", {});
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/run.pcap: No such file"), std::string::npos) << error.what();
  }
  if (std::filesystem::exists("/dev/full")) {
    EXPECT_THROW(sim::WireFile("/dev/full", {}), std::runtime_error);
  }
}

}  // namespace
