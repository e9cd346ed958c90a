#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <zmq.hpp>

#include "frankapy/proto/service.pb.h"
#include "server/keys.hpp"

namespace server {

// What the first fields of a request say.
struct Head {
  std::optional<std::uint64_t> request_id;
  int call = frankapy::proto::Request::CALL_NOT_SET;  // number of its field, which need not be one; or it cannot be seen so soon
};

// A request as it has arrived.
struct Arrived {
  std::string client;  // ROUTER's identity
  Keys::Client who;    // by the connection
  zmq::message_t frame;
  Head head;
  std::uint64_t skill = 0;  // its id where it may move the arm: given on arrival, so that a Stop behind it counts for it too

  // Whether it is read at once; what is longer takes too long for that.
  bool is_short() const;
};

// The requests that have arrived at a ROUTER and wait for their turn, a bounded number. What cannot be one is counted and logged.
class Inbox {
 public:
  // `keys`: those of the socket, or null.
  Inbox(zmq::socket_t& socket, const Keys* keys) : socket_(socket), keys_(keys) {}

  // The next one from the socket; none: there is no other now.
  std::optional<Arrived> receive();

  // False, and nothing is taken, where too many wait.
  bool put(Arrived& arrived);
  std::optional<Arrived> take();
  std::size_t waiting() const { return waiting_.size(); }

  void count_garbage(const std::string& what);
  // Messages that could not be read or were none of service.proto. From any thread.
  std::uint64_t garbage() const { return garbage_.load(std::memory_order_relaxed); }

 private:
  using Clock = std::chrono::steady_clock;

  zmq::socket_t& socket_;
  const Keys* keys_;
  std::deque<Arrived> waiting_;
  std::size_t waiting_bytes_ = 0;
  std::atomic<std::uint64_t> garbage_{0};
  Clock::time_point garbage_told_{};
};

}  // namespace server
