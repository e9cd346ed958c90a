#pragma once

#include <utility>

#include "sim/door/port.hpp"
#include "sim/robot/gripper.hpp"

namespace sim {

// The hand's port: commands over TCP, answered when they have ended; states over UDP.
class GripperServer : public Port {
 public:
  // Throws std::runtime_error when the port cannot be had.
  GripperServer(const in_addr& address, Gripper& gripper, Poller& poller);

  // After each cycle: now and then a state, and the answer to a command that has ended.
  void publish();

  // The hand as it is now, and the command that it does.
  struct Moment {
    Gripper gripper;
    std::uint64_t command = 0;  // that its client waits for; 0: none
  };
  Moment save() const { return {gripper_, under_way_ ? commands_ : 0}; }
  // The hand becomes what it was. A command under way that it did not do then is aborted for its client.
  void restore(const Moment& moment);

 private:
  Header read_header(std::span<const std::byte> bytes) const override;
  bool connect(Connection& newcomer, std::uint32_t id, std::uint16_t version, std::uint16_t udp_port) override;
  std::string_view request_name(std::uint32_t command) const override;
  bool handle(const Header& header, std::span<const std::byte> body) override;
  void gone() override;

  template <class Request, class Begin>
  bool take(std::span<const std::byte> body, Begin&& begin);
  void answer(fci::gripper::Command command, std::uint32_t id, fci::gripper::Status status);
  void abort();

  Gripper& gripper_;
  File udp_;
  std::optional<std::pair<fci::gripper::Command, std::uint32_t>> under_way_;  // and its id
  std::uint64_t commands_ = 0;                                                // that have been taken
  std::uint32_t message_id_ = 0;
  int cycle_ = 0;
};

}  // namespace sim
