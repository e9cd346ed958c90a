#include "sim/door/control/control_server.hpp"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <stdexcept>

namespace sim {
namespace {

constexpr int kMaxCall = 1 << 16;  // bytes
// Calls that a client has sent before it has its answers, and answers that it does not fetch; further ones wait with it, or
// are dropped. Otherwise who only sends could have any memory.
constexpr int kMostWaiting = 4;
constexpr int kLookUp = 100;  // ms after which the thread looks whether it is to end

}  // namespace

ControlServer::ControlServer(Cell& cell, std::size_t arm, const std::string& address)
    : calls_(cell, arm), socket_(context_, ZMQ_REP) {
  socket_.set(zmq::sockopt::linger, 0);
  socket_.set(zmq::sockopt::maxmsgsize, std::int64_t{kMaxCall});
  socket_.set(zmq::sockopt::rcvhwm, kMostWaiting);
  socket_.set(zmq::sockopt::sndhwm, kMostWaiting);
  socket_.set(zmq::sockopt::rcvtimeo, kLookUp);
  const std::string endpoint = fmt::format("tcp://{}:{}", address, kPort);
  try {
    socket_.bind(endpoint);
  } catch (const zmq::error_t& error) {
    throw std::runtime_error("the control channel cannot use " + endpoint + ": " + error.what());
  }
  thread_ = std::thread([this] { run(); });
}

ControlServer::~ControlServer() {
  ends_ = true;
  thread_.join();
}

void ControlServer::run() {
  while (!ends_) {
    zmq::message_t frame;
    try {
      if (!socket_.recv(frame)) continue;
      bool more = frame.more();
      while (more) {
        zmq::message_t rest;
        (void)socket_.recv(rest);
        more = rest.more();
        frame.rebuild();
      }
      const auto answer = calls_.answer({frame.data<std::byte>(), frame.size()});
      // Has ZeroMQ look at what it has sent: what it does not know of yet counts as waiting, and beyond kMostWaiting answers are
      // dropped without a word.
      (void)socket_.get(zmq::sockopt::events);
      (void)socket_.send(zmq::buffer(answer));
    } catch (const zmq::error_t& error) {
      if (error.num() != EINTR) spdlog::warn("control channel: {}", error.what());
    }
  }
}

}  // namespace sim
