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

 private:
  Header read_header(std::span<const std::byte> bytes) const override;
  bool connect(Connection& newcomer, std::uint32_t id, std::uint16_t version, std::uint16_t udp_port) override;
  std::string_view request_name(std::uint32_t command) const override;
  bool handle(const Header& header, std::span<const std::byte> body) override;
  void gone() override;

  template <class Request, class Begin>
  bool take(std::span<const std::byte> body, Begin&& begin);
  void answer(fci::gripper::Command command, std::uint32_t id, fci::gripper::Status status);

  Gripper& gripper_;
  File udp_;
  std::optional<std::pair<fci::gripper::Command, std::uint32_t>> under_way_;  // and its id
  std::uint32_t message_id_ = 0;
  int cycle_ = 0;
};

}  // namespace sim
