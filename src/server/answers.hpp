#pragma once

#include <cstdint>
#include <exception>
#include <string>
#include <zmq.hpp>

#include "frankapy/proto/service.pb.h"
#include "server/keys.hpp"

namespace server {

// Whom to answer.
struct Address {
  std::string client;  // ROUTER's identity
  std::uint64_t request_id = 0;
  Keys::Client who = {};  // by the connection
};

// What clients are told, over the socket of their requests and from its thread. To a client that is gone or does not read nothing
// is sent; nobody waits.
class Answers {
 public:
  explicit Answers(zmq::socket_t& socket) : socket_(socket) {}

  void send(const Address& to, frankapy::proto::Reply& reply);
  void send_error(const Address& to, frankapy::proto::Error::Code code, const std::string& message);
  void send_done(const Address& to);
  // What dealing with a request has thrown.
  void refuse(const Address& from, const std::exception_ptr& thrown);

 private:
  zmq::socket_t& socket_;
};

}  // namespace server
