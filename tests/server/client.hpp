#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "tests/server/skills.hpp"

namespace server {

// One client on a socket of its own.
class Client {
 public:
  // `prepare`: its socket, before that is connected.
  Client(zmq::context_t& context, const std::string& endpoint, const std::function<void(zmq::socket_t&)>& prepare = [](auto&) {})
      : socket_(context, zmq::socket_type::dealer) {
    socket_.set(zmq::sockopt::linger, 0);
    socket_.set(zmq::sockopt::rcvtimeo, 20000);
    prepare(socket_);
    socket_.connect(endpoint);
  }

  std::uint64_t send(proto::Request request) {
    request.set_request_id(++id_);
    send_bytes(request.SerializeAsString());
    return id_;
  }
  void send_bytes(const std::string& bytes) { socket_.send(zmq::buffer(bytes), zmq::send_flags::none); }
  void send_frames(const std::vector<std::string>& frames) {
    for (std::size_t i = 0; i < frames.size(); ++i) {
      socket_.send(zmq::buffer(frames[i]), i + 1 < frames.size() ? zmq::send_flags::sndmore : zmq::send_flags::none);
    }
  }

  // The next answer; an empty one when there is none for 20 s.
  proto::Reply receive() {
    zmq::message_t message;
    proto::Reply reply;
    if (socket_.recv(message)) reply.ParseFromArray(message.data(), static_cast<int>(message.size()));
    return reply;
  }
  proto::Reply ask(const proto::Request& request) {
    const auto id = send(request);
    proto::Reply reply = receive();
    EXPECT_EQ(reply.request_id(), id);
    return reply;
  }

  proto::Reply hello() {
    proto::Request request;
    request.mutable_hello()->set_version(proto::CURRENT);
    request.mutable_hello()->set_client("test");
    return ask(request);
  }
  proto::Reply start(const proto::Skill& skill, bool preempt = false) {
    proto::Request request;
    *request.mutable_start_skill()->mutable_skill() = skill;
    request.mutable_start_skill()->set_preempt(preempt);
    return ask(request);
  }
  proto::Reply start_after(const proto::Skill& skill, std::uint64_t before) {
    proto::Request request;
    *request.mutable_start_skill()->mutable_skill() = skill;
    request.mutable_start_skill()->set_after(before);
    return ask(request);
  }
  proto::Reply stop() {
    proto::Request request;
    request.mutable_stop_skill();
    return ask(request);
  }
  proto::Reply state() {
    proto::Request request;
    request.mutable_get_state();
    return ask(request);
  }
  proto::Reply say_goodbye() {
    proto::Request request;
    request.mutable_goodbye();
    return ask(request);
  }
  proto::Reply recover() {
    proto::Request request;
    request.mutable_recover();
    return ask(request);
  }
  proto::Reply list_arms() {
    proto::Request request;
    request.mutable_list_arms();
    return ask(request);
  }

 private:
  zmq::socket_t socket_;
  std::uint64_t id_ = 0;
};

}  // namespace server
