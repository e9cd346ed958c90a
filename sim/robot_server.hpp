#pragma once

#include "sim/port.hpp"
#include "sim/robot.hpp"
#include "wire/fci/service.hpp"

namespace sim {

// The robot's port: requests over TCP, states and commands over UDP.
class RobotServer : public Port {
 public:
  // `only`: the version of that system; empty: every client's own. Throws std::runtime_error when the port cannot
  // be had.
  RobotServer(const models::Arm& arm, const in_addr& address, std::optional<fci::Version> only, Robot& robot,
              Poller& poller);

  // The command for the robot's last state, if it is there; nullptr otherwise. Valid until the next call.
  const fci::RobotCommand* receive();
  // The same, and waits for it a millisecond or so.
  const fci::RobotCommand* wait();

  // Sends the robot's state, then the answers that it makes true.
  void publish();

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
  const fci::RobotCommand* receive(int flags);

  const models::Arm& arm_;
  std::optional<fci::Version> only_;
  Robot& robot_;
  File udp_;
  // Of the client.
  fci::Version version_ = fci::kNewestVersion;
  std::size_t state_size_ = 0, command_size_ = 0;         // bytes
  bool refused_datagram_ = false;
  std::optional<std::uint32_t> move_, stop_, recovery_;  // ids of requests to be answered when a state has shown it

  fci::RobotCommand command_;
};

}  // namespace sim
