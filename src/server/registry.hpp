#pragma once

#include <google/protobuf/any.pb.h>

#include <memory>
#include <string>
#include <vector>

#include "models/arm.hpp"
#include "realtime/controllers/controller.hpp"
#include "realtime/terminations/termination.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace server {

// Each constructs the component whose message the Any holds, for an arm of these limits. Throws
// Refused: an unknown kind (with those known), bytes that are not the message, values against the
// message's rules or the component's own.
std::unique_ptr<realtime::TrajectoryGenerator> make_trajectory(const google::protobuf::Any& any,
                                                               const models::Limits& limits);
std::unique_ptr<realtime::Controller> make_controller(const google::protobuf::Any& any,
                                                      const models::Limits& limits);
std::unique_ptr<realtime::Termination> make_termination(const google::protobuf::Any& any,
                                                        const models::Limits& limits);

// Names of the kinds that the registry has, in its order.
std::vector<std::string> trajectory_kinds();
std::vector<std::string> controller_kinds();
std::vector<std::string> termination_kinds();

// Those that take references of that kind, joined with commas: what to use instead.
std::string controllers_that_accept(realtime::ReferenceKind kind, const models::Limits& limits);
std::string terminations_that_accept(realtime::ReferenceKind kind, const models::Limits& limits);

// Name of the message in an Any: "MinJerkJoint".
std::string kind_of(const google::protobuf::Any& any);

}  // namespace server
