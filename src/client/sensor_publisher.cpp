#include "client/sensor_publisher.hpp"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <optional>
#include <random>
#include <stdexcept>
#include <zmq.hpp>

#include "client/key.hpp"
#include "frankapy/proto/sensors.pb.h"
#include "frankapy/proto/service.pb.h"
#include "wire/proto/validation.hpp"

namespace client {
namespace {

namespace proto = frankapy::proto;

constexpr std::size_t kMaxTopicName = 256;  // bytes
constexpr std::size_t kMaxMessage = (1 << 16) - 64;  // bytes; a longer one would end its connection (src/server/sensor_hub.cpp)
constexpr int kSilence = 3000;              // ms without an answer after which a server is taken for none
constexpr int kLinger = 1000;               // ms that an ending program waits for what it has just published
constexpr int kSendQueue = 10'000;          // messages
constexpr int kRoundTrips = 5;              // of which the shortest tells how long a way takes

std::string address_of(const std::string& server) {
  const char* variable = std::getenv("FRANKA_INTERFACE_SERVER");
  std::string address = !server.empty() ? server : variable != nullptr && *variable != 0 ? variable : "127.0.0.1";
  if (address.starts_with("tcp://")) address.erase(0, 6);
  return address.find(':') == std::string::npos ? address + ":5757" : address;
}

bool is_this_computer(const std::string& address) { return address.starts_with("127.") || address.starts_with("localhost:"); }

// An endpoint as seen from here: 0.0.0.0 stands for the host under which the server was reached.
std::string reachable(std::string endpoint, const std::string& address) {
  const std::string all = "://0.0.0.0:";
  if (const auto at = endpoint.find(all); at != std::string::npos) {
    endpoint.replace(at, all.size(), "://" + address.substr(0, address.rfind(':')) + ":");
  }
  return endpoint;
}

struct Server {
  std::string endpoint;  // of the arm's process, for sensor messages
  std::int64_t way_ns;   // half of the shortest round trip
};

struct NoAnswer : std::runtime_error {
  using std::runtime_error::runtime_error;
};

Server find(zmq::context_t& context, const std::string& address, int robot_num, const std::optional<Key>& key) {
  zmq::socket_t socket(context, zmq::socket_type::dealer);
  socket.set(zmq::sockopt::linger, 0);
  socket.set(zmq::sockopt::rcvtimeo, kSilence);
  if (key) key->use_for(socket);
  try {
    socket.connect("tcp://" + address);
  } catch (const zmq::error_t&) {
    throw std::invalid_argument("server is \"" + address + "\": expected host or host:port, as in \"127.0.0.1:5757\"");
  }
  proto::Request request;
  request.set_request_id(1);
  request.mutable_list_arms();
  const std::string question = request.SerializeAsString();
  proto::Reply reply;
  auto shortest = std::chrono::nanoseconds::max();
  for (int i = 0; i < kRoundTrips; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    socket.send(zmq::buffer(question), zmq::send_flags::none);
    zmq::message_t answer;
    if (!socket.recv(answer) || !reply.ParseFromArray(answer.data(), static_cast<int>(answer.size())) || !reply.has_arms()) {
      throw NoAnswer("no franka-interface answers at " + address + ": does it run there" +
                     (key ? ", with keys, and does it know the one of " + key->file() + "?" : ", without keys? There is none here"));
    }
    shortest = std::min<std::chrono::nanoseconds>(shortest, std::chrono::steady_clock::now() - begin);
  }
  if (reply.arms().version() != proto::CURRENT) {
    throw std::runtime_error("the server at " + address + " speaks version " + std::to_string(reply.arms().version()) +
                             ", this program version " + std::to_string(proto::CURRENT) + ": build both from one source");
  }
  const int arms = reply.arms().arms_size();
  if (robot_num < 1 || robot_num > arms) {
    throw std::invalid_argument("robot_num is " + std::to_string(robot_num) + ": expected 1 to " + std::to_string(arms) +
                                ", the arms of the server");
  }
  const auto& arm = reply.arms().arms(robot_num - 1);
  if (!arm.has_sensor_endpoint()) throw std::runtime_error("the arm " + arm.name() + " is not ready: " + arm.status());
  return {reachable(arm.sensor_endpoint(), address), shortest.count() / 2};
}

std::uint64_t random_id() {
  std::random_device device;
  return (static_cast<std::uint64_t>(device()) << 31) ^ device();
}

}  // namespace

struct SensorPublisher::Socket {
  zmq::context_t context;
  zmq::socket_t push{context, zmq::socket_type::push};
};

SensorPublisher::SensorPublisher(const std::string& topic, const std::string& server, int robot_num, const std::string& key)
    : topic_(topic), id_(random_id()), socket_(std::make_unique<Socket>()) {
  if (topic.empty() || topic.size() > kMaxTopicName) {
    throw std::invalid_argument("topic has " + std::to_string(topic.size()) + " bytes: expected 1 to " +
                                std::to_string(kMaxTopicName));
  }
  socket_->push.set(zmq::sockopt::linger, kLinger);
  socket_->push.set(zmq::sockopt::sndhwm, kSendQueue);
  const std::string address = address_of(server);
  std::optional<Key> own = Key::find(key);
  Server found;
  try {
    found = find(socket_->context, address, robot_num, own);
  } catch (const NoAnswer&) {
    if (!own || !key.empty() || !is_this_computer(address)) throw;
    own.reset();
    found = find(socket_->context, address, robot_num, own);
  }
  if (own) own->use_for(socket_->push);
  way_ns_ = found.way_ns;
  socket_->push.connect(found.endpoint);
}

SensorPublisher::~SensorPublisher() = default;

void SensorPublisher::publish(const google::protobuf::Message& message) {
  const std::unique_ptr<google::protobuf::Message> checked(message.New());
  checked->CopyFrom(message);
  wire::validate(*checked);
  proto::SensorMessage envelope;
  envelope.set_topic(topic_);
  envelope.set_publisher(id_);
  envelope.set_sequence(++sequence_);
  envelope.set_sent_ns(std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count());
  envelope.set_way_ns(way_ns_);
  envelope.mutable_message()->PackFrom(*checked);
  const std::string bytes = envelope.SerializeAsString();
  if (bytes.size() > kMaxMessage) {
    throw std::invalid_argument(checked->GetDescriptor()->name() + " has " + std::to_string(bytes.size()) +
                                " bytes with its envelope: expected at most " + std::to_string(kMaxMessage) + ". Send less at a time");
  }
  if (!socket_->push.send(zmq::buffer(bytes), zmq::send_flags::dontwait)) {
    throw std::runtime_error("the server takes no sensor messages: is it still there?");
  }
}

}  // namespace client
