#pragma once

#include <google/protobuf/message.h>

#include <cstdint>
#include <memory>
#include <string>

namespace client {

// Sends sensor messages over a topic into the skills of an arm that listen to it, from any process and computer: what
// frankapy.SensorPublisher is in Python. What is published is sent at once, waits while the server is being reached, and is sent
// still when the program ends right afterwards. It needs no lease. For one thread.
//
//   client::SensorPublisher publisher("policy");
//   frankapy::proto::JointPositionSensorMessage message;
//   for (double q : target) message.add_joints(q);
//   publisher.publish(message);
class SensorPublisher {
 public:
  // `server`: host or host:port of franka-interface; empty: $FRANKA_INTERFACE_SERVER, else 127.0.0.1:5757. Arms count from 1, in
  // the order of the server's configuration. `key`: the file of a key, where the server has keys (docs/keys.md); empty:
  // $FRANKAPY_KEY, else frankapy/key.json in the user's configuration if that is there; such a key is left out, after 3 s, where a
  // server on this computer has none: a simulated arm beside the arms of a lab. Throws std::invalid_argument for a bad name, number
  // or file, std::runtime_error when there is no server, it lets this key not in, or the arm is not ready.
  explicit SensorPublisher(const std::string& topic, const std::string& server = "", int robot_num = 1, const std::string& key = "");
  // Sends what is left, for at most a second.
  ~SensorPublisher();
  SensorPublisher(const SensorPublisher&) = delete;

  // Sends a message of wire/proto/sensors.proto, or of a part of your own. Throws wire::Invalid for a field against its rule,
  // std::runtime_error when the server takes nothing.
  void publish(const google::protobuf::Message& message);

 private:
  struct Socket;
  const std::string topic_;
  const std::uint64_t id_;
  std::int64_t way_ns_ = 0;  // to the server: half of the shortest round trip
  std::uint64_t sequence_ = 0;
  std::unique_ptr<Socket> socket_;
};

}  // namespace client
