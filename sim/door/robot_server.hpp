#pragma once

#include "sim/door/network.hpp"
#include "sim/door/port.hpp"
#include "sim/door/wire_file.hpp"
#include "sim/robot/robot.hpp"
#include "wire/fci/service.hpp"

namespace sim {

// The robot's port: requests over TCP, states and commands over UDP.
class RobotServer : public Port {
 public:
  // `only`: the version of that system; empty: any that systems of this arm spoke. `wire`: a file for what passes; empty: none.
  // Throws std::runtime_error when the port or the file cannot be had.
  RobotServer(const models::Arm& arm, const in_addr& address, std::optional<fci::Version> only, const std::string& wire,
              Robot& robot, Poller& poller);

  // The command for the robot's last state, if it is there; nullptr otherwise. Valid until the next call.
  const fci::RobotCommand* receive();
  // The same, and waits for it until then (ns, of the clock) or for a millisecond.
  const fci::RobotCommand* wait(std::int64_t until);

  // The command for the robot's last state is lost, or will come too late.
  bool in_vain() const { return in_vain_; }

  // Sends the robot's new state, then the answers that it makes true. `period` (ns of the wall) is how long a cycle takes;
  // 0: as long as its command does, and what is delayed comes cycles later.
  void publish(std::int64_t period);
  // Sends the last one again, as a sign of life.
  void repeat();
  // Sends what the network has held up until now.
  void send_delayed(std::int64_t now);
  // When there is such (ns, of the clock).
  std::optional<std::int64_t> next_delayed() const;

  Network& network() { return network_; }

  // Robot and network as they are now, and what is under way between them and the client.
  struct Moment;
  // Throws std::runtime_error while the client waits for the end of a motion that is being stopped, or of a recovery.
  Moment save() const;
  // Throws std::runtime_error which says why the client, who is not taken back with the robot, could not go on from that
  // moment: another motion runs now than then, or one is being stopped.
  void require_restorable(const Moment& moment) const;
  // The robot becomes what it was; it goes on with its client and its count of states. In a motion the client has the
  // state of that moment at once, under a new message_id, and what it has commanded before counts for nothing.
  void restore(const Moment& moment);

 private:
  Header read_header(std::span<const std::byte> bytes) const override;
  bool connect(Connection& newcomer, std::uint32_t id, std::uint16_t version, std::uint16_t udp_port) override;
  std::string_view request_name(std::uint32_t command) const override;
  bool handle(const Header& header, std::span<const std::byte> body) override;
  void gone() override;

  template <class Request, class Answer>
  bool take(const Header& header, std::span<const std::byte> body, Answer&& answer_request);
  template <class Request>
  bool set(const Header& header, std::span<const std::byte> body);
  void answer(fci::Command command, std::uint32_t id, fci::Status status, std::span<const std::byte> more = {});
  const fci::RobotCommand* take(const fci::RobotCommand& command);
  bool held_up(const fci::RobotCommand& command);
  std::int64_t arrival() const;
  std::int64_t network_time() const;
  void require_settled(const char* wish) const;
  void drop_datagrams();
  void write_state(std::vector<std::byte>& datagram) const;
  void send(std::span<const std::byte> state);
  void send_state();
  void settle();

  const models::Arm& arm_;
  std::optional<fci::Version> only_;
  Robot& robot_;
  Clock& clock_;
  File udp_;
  std::optional<WireFile> wire_;
  // Of the client.
  fci::Version version_ = fci::kNewestVersion;
  std::size_t state_size_ = 0, command_size_ = 0;         // bytes
  bool refused_datagram_ = false;
  std::optional<std::uint32_t> move_, stop_, recovery_;  // ids of requests to be answered when a state has shown it
  std::uint64_t motions_ = 0;                            // that have been accepted

  fci::RobotCommand command_;
  std::vector<std::byte> sent_;  // the last state

  template <class What>
  struct Delayed {
    std::int64_t due;  // ns, or message_id
    What what;
  };
  using DelayedState = Delayed<std::vector<std::byte>>;
  using DelayedCommand = Delayed<fci::RobotCommand>;
  Network network_;
  std::vector<DelayedState> delayed_states_;
  std::vector<DelayedCommand> delayed_commands_;
  std::int64_t period_ = 0;
  bool in_vain_ = false;
};

struct RobotServer::Moment {
  Robot robot;
  std::uint64_t motion;  // that its client was in; 0: none
  Network network;
  bool in_vain;
  std::vector<DelayedState> delayed_states;  // due after the moment
  std::vector<DelayedCommand> delayed_commands;
};

}  // namespace sim
