#pragma once

#include <google/protobuf/any.pb.h>
#include <google/protobuf/descriptor.h>

#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "realtime/arm.hpp"
#include "realtime/controllers/controller.hpp"
#include "realtime/soft_ending.hpp"
#include "realtime/terminations/termination.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"
#include "wire/proto/validation.hpp"

namespace frankapy::proto {}

namespace server {

namespace proto = frankapy::proto;

// Name of a kind, by the full name of its message: a message from elsewhere keeps its package.
inline std::string kind_name(const std::string& full_name) {
  const std::string own = "frankapy.proto.";
  return full_name.starts_with(own) ? full_name.substr(own.size()) : full_name;
}

// A kind of part: the name of its message, and how it is made of one. `make` throws wire::Invalid or
// std::invalid_argument.
template <class Base>
struct Kind {
  std::string name;
  std::function<std::unique_ptr<Base>(const google::protobuf::Any&, const realtime::Arm&)> make;
  const google::protobuf::Descriptor* message;
};

// All of them, in the order of wire/proto; one file of this folder each. Those of libraries (server/plugins.hpp) are added
// behind them before any skill is made.
std::vector<Kind<realtime::TrajectoryGenerator>>& trajectories();
std::vector<Kind<realtime::Controller>>& controllers();
std::vector<Kind<realtime::Termination>>& terminations();
std::vector<Kind<realtime::SoftEnding>>& endings();

// The kind of that message; `make(message, arm)` returns a new part.
template <class Base, class Message, class Make>
Kind<Base> kind(Make make) {
  return {kind_name(Message::descriptor()->full_name()), [make](const google::protobuf::Any& any, const realtime::Arm& arm) {
            Message message;
            wire::unpack(any, message);
            return std::unique_ptr<Base>(make(message, arm));
          },
          Message::descriptor()};
}

// --- fields ----------------------------------------------------------------------------------------------------------

template <int N>
Eigen::Matrix<double, N, 1> vector(const google::protobuf::RepeatedField<double>& field) {
  return Eigen::Map<const Eigen::Matrix<double, N, 1>>(field.data());  // its size was checked
}

template <int N>
std::optional<Eigen::Matrix<double, N, 1>> given(const google::protobuf::RepeatedField<double>& field) {
  if (field.empty()) return std::nullopt;
  return vector<N>(field);
}
template <class Value>
std::optional<Value> given(bool has, Value value) {
  return has ? std::optional(value) : std::nullopt;
}

inline Eigen::Quaterniond quaternion(const google::protobuf::RepeatedField<double>& field) {
  return {field.Get(0), field.Get(1), field.Get(2), field.Get(3)};
}

}  // namespace server
