#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <memory>
#include <netinet/in.h>
#include <string>
#include <sys/socket.h>

#include "robot/driver.hpp"
#include "robot/socket.hpp"

namespace robot {

// What a client of the robot waits for at most.
struct FciTimes {
  std::chrono::milliseconds connect{2000};  // each step of connecting
  std::chrono::milliseconds model{5000};    // the URDF, some 10 kB
  std::chrono::milliseconds silence{1000};  // receive()
};

// The native FCI client: one arm of protocol version 5 to 10, over TCP port 1337 and UDP.
class FciDriver final : public Driver {
 public:
  // Asks the arm for its version, speaks it, and returns when states flow; a few seconds at most. Throws
  // ConnectError. For the server room, as is everything down to `counters`.
  static std::unique_ptr<FciDriver> connect(const std::string& address, const FciTimes& times = {});

  // The robot's URDF (protocol 8 and later); empty when it has or gives none.
  const std::string& robot_model() const { return robot_model_; }
  // The newest state at the end of connect().
  const fci::RobotState& first_state() const { return first_state_; }

  // What was not taken: readable from any thread, also when the driver is gone.
  struct Counters {
    std::atomic<std::uint64_t> wrong_size{0};   // truncated, oversized, of another version
    std::atomic<std::uint64_t> bad_values{0};   // not finite where the server counts on it, or a mode that there is not
    std::atomic<std::uint64_t> old{0};          // message_id not above the last one
    std::atomic<std::uint64_t> foreign{0};      // from another address than the first state
    std::atomic<std::uint64_t> unsent{0};       // commands that the network did not take
    std::atomic<std::uint64_t> unasked{0};      // answers to no request, or to one that was answered

    // "12 datagrams of the wrong size, 3 from another address"; empty when there was nothing.
    std::string text() const;
  };
  const Counters& counters() const { return *counters_; }
  std::shared_ptr<const Counters> shared_counters() const { return counters_; }

  // Why receive() says kLost, for people; null before.
  const char* lost() const { return lost_.load(); }

  Received receive(fci::RobotState& state) noexcept override;
  std::int64_t received_ns() const noexcept override { return received_ns_; }
  void send(const fci::RobotCommand& command) noexcept override;
  std::optional<std::uint32_t> post(const Request& request) noexcept override;
  std::optional<Answer> poll() noexcept override;
  fci::Version version() const noexcept override { return version_; }

 private:
  FciDriver(Peer peer, Socket tcp, Socket udp, const FciTimes& times);

  int wait() noexcept;
  bool take_newest(int datagrams, fci::RobotState& state) noexcept;
  bool read_state(const std::byte* datagram, fci::RobotState& state) noexcept;
  void read_tcp() noexcept;
  void flush() noexcept;
  void lose(const char* why) noexcept;
  bool asked_for(std::uint32_t id, fci::Command command, fci::Status status) noexcept;
  fci::Version settle_version(std::uint16_t offered, std::uint16_t answered, Clock::time_point deadline);
  void fetch_robot_model(Clock::time_point deadline);

  // Room for the states of a client that was away for a while; all of one recvmmsg().
  static constexpr int kDatagrams = 16;
  static constexpr std::size_t kDatagramRoom = 2560;  // above every state, so that an oversized one shows
  struct Datagrams {
    std::array<std::array<std::byte, kDatagramRoom>, kDatagrams> bytes;
    std::array<sockaddr_in, kDatagrams> from;
    std::array<iovec, kDatagrams> pieces;
    std::array<mmsghdr, kDatagrams> headers;
  };

  // Of the newest ones; an older one that is still open is forgotten.
  static constexpr std::size_t kOpenRequests = 64;
  struct OpenRequest {
    std::uint32_t id = 0;  // 0: none
    fci::Command command = fci::Command::kConnect;
    bool due = false;  // not answered at all yet
  };

  const Peer peer_;
  const FciTimes times_;
  Socket tcp_, udp_;
  fci::Version version_ = 0;
  std::size_t state_size_ = 0, command_size_ = 0;  // bytes
  std::string robot_model_;
  fci::RobotState first_state_;

  Datagrams in_;
  fci::RobotState scratch_;         // read, not yet judged
  sockaddr_in commands_to_{};       // where the last state came from
  std::uint64_t newest_ = 0;        // message_id
  bool any_state_ = false;
  std::int64_t received_ns_ = 0;
  bool short_wait_ = false;         // the last, for a state
  int pause_ = 0;                   // waits until the next that may poll

  std::uint32_t next_id_ = 0;       // of requests
  std::array<std::byte, 4096> tcp_out_;  // what the socket did not take at once
  std::size_t tcp_out_size_ = 0;
  std::array<std::byte, 4096> tcp_in_;
  std::size_t tcp_in_size_ = 0;
  std::uint64_t skip_ = 0;          // bytes of a response that nobody wants
  std::array<OpenRequest, kOpenRequests> open_;  // by id, modulo its size
  int awaited_ = 0;                 // of these, how many are due
  int since_tcp_ = 0;               // polls since TCP was last read
  std::atomic<const char*> lost_{nullptr};
  const std::shared_ptr<Counters> counters_ = std::make_shared<Counters>();
};

}  // namespace robot
