#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <unistd.h>

#include <sstream>
#include <string>

#include "free_address.hpp"
#include "sim/cell.hpp"

namespace testing_tools {

// Time that goes on when somebody waits for it.
class DrivenClock final : public sim::Clock {
 public:
  std::int64_t now() const override { return now_; }
  void sleep_until(std::int64_t time) override { now_ = std::max(now_, time); }
  void wait_for(int socket, std::int64_t time) override {
    pollfd wanted{socket, POLLIN, 0};
    if (::poll(&wanted, 1, 0) <= 0) sleep_until(time);
  }
  // Time in which nobody here was run.
  void stall(std::int64_t time) { now_ += time; }

 private:
  std::int64_t now_ = 1'000'000'000;  // ns
};

// A simulated arm in this thread, on an address of its own, whose cycles are run by whoever waits for something from it.
class DrivenArm {
 public:
  explicit DrivenArm(const std::string& robot = "fr3", sim::Cell::Options options = {}, const std::string& truth = "")
      : address_(free_address()), cell_(with_arm(options, robot, truth), clock_), commands_(socket_of(address_)) {
    spdlog::set_default_logger(
        std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_st>(log_)));
  }
  ~DrivenArm() { spdlog::set_default_logger(before_); }
  DrivenArm(const DrivenArm&) = delete;

  const std::string& address() const { return address_; }
  std::string log() const { return log_.str(); }
  void cycle() { cell_.run_cycle(); }
  sim::Cell& cell() { return cell_; }
  // ns of the arm's clock.
  std::int64_t now() const { return clock_.now(); }
  void stall(std::int64_t time) { clock_.stall(time); }

  // A datagram that was sent to the robot's port is there; kernels mostly deliver at once, and not always.
  void wait_for_datagram() const {
    pollfd wanted{commands_, POLLIN, 0};
    ::poll(&wanted, 1, 10'000);
  }

 private:
  sim::Cell::Options with_arm(sim::Cell::Options options, const std::string& robot, const std::string& truth) const {
    const std::string wire = options.arms.empty() ? "" : options.arms.front().wire;
    options.arms = {{&models::arm(robot), sim::parse_address(address_), truth, wire}};
    return options;
  }
  // This process's own UDP socket at the robot's port.
  static int socket_of(const std::string& address) {
    for (int fd = 0; fd < 1024; ++fd) {
      sockaddr_in own{};
      socklen_t size = sizeof own;
      int type = 0;
      socklen_t type_size = sizeof type;
      if (::getsockname(fd, reinterpret_cast<sockaddr*>(&own), &size) == 0 && own.sin_family == AF_INET &&
          ntohs(own.sin_port) == fci::kRobotPort && sim::text(own.sin_addr) == address &&
          ::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_size) == 0 && type == SOCK_DGRAM) {
        return fd;
      }
    }
    throw std::runtime_error("the arm has no socket");
  }

  std::string address_;
  DrivenClock clock_;
  std::shared_ptr<spdlog::logger> before_ = spdlog::default_logger();
  std::ostringstream log_;
  sim::Cell cell_;
  int commands_;
};

inline sim::Cell::Options lockstep(bool ideal = false) {
  sim::Cell::Options options;
  options.lockstep = true;
  options.ideal = ideal;
  return options;
}

}  // namespace testing_tools
