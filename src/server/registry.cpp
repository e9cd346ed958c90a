#include "server/registry.hpp"

#include <spdlog/fmt/fmt.h>

#include <functional>
#include <optional>

#include "frankapy/proto/controllers.pb.h"
#include "frankapy/proto/terminations.pb.h"
#include "frankapy/proto/trajectories.pb.h"
#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/controllers/internal_impedance.hpp"
#include "realtime/controllers/joint_impedance.hpp"
#include "realtime/terminations/final_joint.hpp"
#include "realtime/terminations/final_pose.hpp"
#include "realtime/terminations/time.hpp"
#include "realtime/trajectories/min_jerk_joint.hpp"
#include "realtime/trajectories/min_jerk_pose.hpp"
#include "realtime/trajectories/relative_min_jerk_joint.hpp"
#include "realtime/trajectories/relative_min_jerk_pose.hpp"
#include "server/refused.hpp"
#include "server/validation.hpp"

namespace server {
namespace {

using google::protobuf::Any;
using google::protobuf::RepeatedField;

template <int N>
Eigen::Matrix<double, N, 1> vector(const RepeatedField<double>& field) {
  return Eigen::Map<const Eigen::Matrix<double, N, 1>>(field.data());  // its size was checked
}

template <int N>
std::optional<Eigen::Matrix<double, N, 1>> given(const RepeatedField<double>& field) {
  if (field.empty()) return std::nullopt;
  return vector<N>(field);
}

Eigen::Quaterniond quaternion(const RepeatedField<double>& field) {
  return {field.Get(0), field.Get(1), field.Get(2), field.Get(3)};
}

template <class Base>
struct Kind {
  std::string name;
  std::function<std::unique_ptr<Base>(const Any&, const models::Limits&)> make;
};

// A kind: its message, and how its component is made of it.
template <class Base, class Message, class Make>
Kind<Base> kind(Make make) {
  return {Message::descriptor()->name(), [make](const Any& any, const models::Limits& limits) {
            Message message;
            if (!any.UnpackTo(&message)) {
              throw Refused(proto::Error::INVALID_ARGUMENT,
                            fmt::format("{} bytes that are no {}", any.value().size(), Message::descriptor()->name()));
            }
            validate(message);
            return std::unique_ptr<Base>(make(message, limits));
          }};
}

template <class Message, class Make>
auto trajectory(Make make) {
  return kind<realtime::TrajectoryGenerator, Message>(make);
}
template <class Message, class Make>
auto controller(Make make) {
  return kind<realtime::Controller, Message>(make);
}
template <class Message, class Make>
auto termination(Make make) {
  return kind<realtime::Termination, Message>(make);
}

const std::vector<Kind<realtime::TrajectoryGenerator>> kTrajectories = {
    trajectory<proto::MinJerkJoint>([](const auto& m, const auto& limits) {
      return new realtime::MinJerkJoint({vector<7>(m.q()), m.duration()}, limits);
    }),
    trajectory<proto::RelativeMinJerkJoint>([](const auto& m, const auto& limits) {
      return new realtime::RelativeMinJerkJoint({vector<7>(m.delta_q()), m.duration()}, limits);
    }),
    trajectory<proto::MinJerkPose>([](const auto& m, const auto& limits) {
      return new realtime::MinJerkPose({vector<3>(m.position()), quaternion(m.quaternion()), m.duration()}, limits);
    }),
    trajectory<proto::RelativeMinJerkPose>([](const auto& m, const auto& limits) {
      using Frame = realtime::RelativeMinJerkPose::Frame;
      return new realtime::RelativeMinJerkPose(
          {vector<3>(m.translation()), quaternion(m.quaternion()),
           m.frame() == proto::RelativeMinJerkPose::BASE ? Frame::kBase : Frame::kEndEffector, m.duration()},
          limits);
    }),
};

const std::vector<Kind<realtime::Controller>> kControllers = {
    controller<proto::JointImpedance>([](const auto& m, const auto&) {
      return new realtime::JointImpedance({vector<7>(m.stiffness()), vector<7>(m.damping())});
    }),
    controller<proto::CartesianImpedance>([](const auto& m, const auto&) {
      return new realtime::CartesianImpedance({vector<3>(m.translational_stiffness()),
                                               vector<3>(m.rotational_stiffness()), m.damping_ratio(),
                                               m.nullspace_stiffness()});
    }),
    controller<proto::InternalImpedance>([](const auto& m, const auto&) {
      return new realtime::InternalImpedance({given<7>(m.k_theta()), given<6>(m.k_x())});
    }),
};

const std::vector<Kind<realtime::Termination>> kTerminations = {
    termination<proto::Time>([](const auto& m, const auto&) {
      return new realtime::Time({m.has_seconds() ? std::optional(m.seconds()) : std::nullopt,
                                 m.has_after_trajectory() ? std::optional(m.after_trajectory()) : std::nullopt});
    }),
    termination<proto::FinalJoint>([](const auto& m, const auto&) {
      return new realtime::FinalJoint({vector<7>(m.threshold())});
    }),
    termination<proto::FinalPose>([](const auto& m, const auto&) {
      return new realtime::FinalPose({vector<3>(m.position_threshold()), m.orientation_threshold()});
    }),
};

template <class Base>
std::vector<std::string> names(const std::vector<Kind<Base>>& kinds) {
  std::vector<std::string> names;
  for (const auto& each : kinds) names.push_back(each.name);
  return names;
}

template <class Base>
std::unique_ptr<Base> make(const std::vector<Kind<Base>>& kinds, const std::string& what, const Any& any,
                           const models::Limits& limits) {
  const std::string name = kind_of(any);
  for (const auto& each : kinds) {
    if (each.name != name) continue;
    try {
      return each.make(any, limits);
    } catch (const std::invalid_argument& error) {
      throw Refused(proto::Error::INVALID_ARGUMENT, name + ": " + error.what());
    }
  }
  throw Refused(proto::Error::INVALID_ARGUMENT,
                fmt::format("{} is no {} that this server knows; known are {}. Is the client newer than the server?",
                            name.empty() ? "\"" + any.type_url() + "\"" : name, what, fmt::join(names(kinds), ", ")));
}

template <class Base>
std::string that_accept(const std::vector<Kind<Base>>& kinds, realtime::ReferenceKind reference,
                        const models::Limits& limits) {
  std::string names;
  for (const auto& each : kinds) {
    try {
      Any any;
      any.set_type_url("type.googleapis.com/frankapy.proto." + each.name);
      if (!each.make(any, limits)->accepts(reference)) continue;
    } catch (const std::exception&) {
      continue;  // has no defaults to be made of
    }
    names += (names.empty() ? "" : ", ") + each.name;
  }
  return names.empty() ? "another kind" : names;
}

}  // namespace

std::unique_ptr<realtime::TrajectoryGenerator> make_trajectory(const Any& any, const models::Limits& limits) {
  return make(kTrajectories, "trajectory", any, limits);
}
std::unique_ptr<realtime::Controller> make_controller(const Any& any, const models::Limits& limits) {
  return make(kControllers, "controller", any, limits);
}
std::unique_ptr<realtime::Termination> make_termination(const Any& any, const models::Limits& limits) {
  return make(kTerminations, "termination", any, limits);
}

std::vector<std::string> trajectory_kinds() { return names(kTrajectories); }
std::vector<std::string> controller_kinds() { return names(kControllers); }
std::vector<std::string> termination_kinds() { return names(kTerminations); }

std::string controllers_that_accept(realtime::ReferenceKind kind, const models::Limits& limits) {
  return that_accept(kControllers, kind, limits);
}
std::string terminations_that_accept(realtime::ReferenceKind kind, const models::Limits& limits) {
  return that_accept(kTerminations, kind, limits);
}

std::string kind_of(const Any& any) {
  const std::string prefix = "frankapy.proto.";
  const std::string name = any.type_url().substr(any.type_url().rfind('/') + 1);
  return name.starts_with(prefix) ? name.substr(prefix.size()) : name;
}

}  // namespace server
