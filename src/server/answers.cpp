#include "server/answers.hpp"

#include <spdlog/spdlog.h>

#include "server/refused.hpp"
#include "wire/proto/validation.hpp"

namespace server {

void Answers::send(const Address& to, proto::Reply& reply) {
  reply.set_request_id(to.request_id);
  const std::string bytes = reply.SerializeAsString();
  try {
    socket_.send(zmq::buffer(to.client), zmq::send_flags::sndmore | zmq::send_flags::dontwait);
    socket_.send(zmq::buffer(bytes), zmq::send_flags::dontwait);
  } catch (const zmq::error_t& error) {
    spdlog::debug("a reply was not sent: {}", error.what());
  }
}

void Answers::send_error(const Address& to, proto::Error::Code code, const std::string& message) {
  proto::Reply reply;
  reply.mutable_error()->set_code(code);
  reply.mutable_error()->set_message(message);
  send(to, reply);
}

void Answers::send_done(const Address& to) {
  proto::Reply reply;
  reply.mutable_done();
  send(to, reply);
}

void Answers::refuse(const Address& from, const std::exception_ptr& thrown) {
  try {
    std::rethrow_exception(thrown);
  } catch (const Refused& refused) {
    spdlog::debug("refused: {}", refused.what());
    send_error(from, refused.code, refused.what());
  } catch (const wire::Invalid& invalid) {
    spdlog::debug("refused: {}", invalid.what());
    send_error(from, proto::Error::INVALID_ARGUMENT, invalid.what());
  } catch (const std::exception& error) {
    spdlog::error("a request failed: {}", error.what());
    send_error(from, proto::Error::INTERNAL, fmt::format("the server failed on this request: {}", error.what()));
  }
}

}  // namespace server
