#pragma once

#include "frankapy/proto/service.pb.h"
#include "realtime/door.hpp"

namespace server {

// Overwrites robot, phase, skill_id, skill_time and what else comes from the record; keeps the rest
// (description, gripper, age).
void convert(const realtime::Record& record, frankapy::proto::ArmState& out);

frankapy::proto::Phase convert(realtime::Phase phase);
frankapy::proto::Ending convert(realtime::Ending ending);

// Fills in everything but `termination` and `last_state`; `message` says for people what happened and
// what to do.
void convert(const realtime::SkillResult& result, frankapy::proto::SkillResult& out);

}  // namespace server
