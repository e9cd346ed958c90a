#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>
#include <zmq.hpp>

#include "server/keys.hpp"

namespace server {

// Tells ZeroMQ whose key is known (ZAP, rfc.zeromq.org/spec/27), for all guarded sockets of a context; a thread of its own. It is
// there before the first of them is bound and until the last is closed: ZeroMQ lets everybody in where nobody can be asked.
class Doorkeeper {
 public:
  Doorkeeper(zmq::context_t& context, Keys& keys);
  ~Doorkeeper();

  // Connections whose key was not known, so far.
  std::uint64_t refused() const { return refused_.load(std::memory_order_relaxed); }

 private:
  void run();
  bool answer();
  void count_refused(const std::string& address);

  Keys& keys_;
  zmq::socket_t socket_;
  std::atomic<std::uint64_t> refused_{0};
  std::atomic<bool> quit_{false};
  std::thread thread_;
};

}  // namespace server
