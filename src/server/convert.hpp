#pragma once

#include <string>

#include "frankapy/proto/service.pb.h"
#include "realtime/door.hpp"

namespace server {

// Overwrites robot, phase, skill_id, skill_time and what else comes from the record; keeps the rest
// (description, gripper, age).
void convert(const realtime::Record& record, frankapy::proto::ArmState& out);

// Where a skill ends.
void convert(const realtime::Reference& goal, frankapy::proto::SkillStarted& out);

frankapy::proto::Phase convert(realtime::Phase phase);
frankapy::proto::Ending convert(realtime::Ending ending);

// What keeps the robot from moving, by the names of its errors or else by its mode, for people.
std::string errors_of(const fci::RobotState& state);

// Fills in everything but `termination` and `last_state`; `message` says for people what happened and
// what to do.
void convert(const realtime::SkillResult& result, frankapy::proto::SkillResult& out);

}  // namespace server
