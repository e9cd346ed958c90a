#pragma once

#include <atomic>
#include <string>
#include <thread>
#include <zmq.hpp>

#include "sim/door/control/control_calls.hpp"

namespace sim {

// The control channel of one arm (wire/proto/simulation.proto): takes calls over ZeroMQ in a thread of its own.
class ControlServer {
 public:
  static constexpr int kPort = 1339;

  // `arm` of the cell. Throws std::runtime_error when the port cannot be had.
  ControlServer(Cell& cell, std::size_t arm, const std::string& address);
  ~ControlServer();

 private:
  void run();

  ControlCalls calls_;
  zmq::context_t context_;
  zmq::socket_t socket_;
  std::atomic<bool> ends_ = false;
  std::thread thread_;
};

}  // namespace sim
