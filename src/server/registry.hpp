#pragma once

#include <google/protobuf/any.pb.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "frankapy/proto/service.pb.h"
#include "realtime/arm.hpp"
#include "realtime/controllers/controller.hpp"
#include "realtime/terminations/termination.hpp"
#include "realtime/trajectories/trajectory_generator.hpp"

namespace server {

// Each constructs the component whose message the Any holds. Throws
// Refused: an unknown kind (with those known), bytes that are not the message, values against the
// message's rules or the component's own.
std::unique_ptr<realtime::TrajectoryGenerator> make_trajectory(const google::protobuf::Any& any,
                                                               const realtime::Arm& arm);
std::unique_ptr<realtime::Controller> make_controller(const google::protobuf::Any& any,
                                                      const realtime::Arm& arm);
std::unique_ptr<realtime::Termination> make_termination(const google::protobuf::Any& any,
                                                        const realtime::Arm& arm);
std::unique_ptr<realtime::SoftEnding> make_ending(const google::protobuf::Any& any, const realtime::Arm& arm);

// Names of the kinds that the registry has, in its order.
std::vector<std::string> trajectory_kinds();
std::vector<std::string> controller_kinds();
std::vector<std::string> termination_kinds();
std::vector<std::string> ending_kinds();

// Those for a trajectory that fills these, joined with commas: what to use instead.
std::string controllers_that_take(realtime::Channels channels, const realtime::Arm& arm);
std::string terminations_that_judge(realtime::Channels channels, const realtime::Arm& arm);

// Name of the message in an Any: "MinJerkJoint"; of a message from elsewhere with its package.
std::string kind_of(const google::protobuf::Any& any);

// Kinds have numbers from 1 on, for where text cannot go (realtime::Skill::numbers); 0: no such kind.
std::uint16_t number_of(const std::string& kind);
// Of all, in the order of their numbers, with their role: "controller JointImpedance".
std::vector<std::string> titles_of_kinds();

// Those that came from libraries.
frankapy::proto::LoadedKinds loaded_kinds();

}  // namespace server
