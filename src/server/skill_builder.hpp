#pragma once

#include <memory>
#include <string>

#include "frankapy/proto/skill.pb.h"
#include "models/arm.hpp"
#include "realtime/door.hpp"
#include "realtime/model.hpp"

namespace server {

// Turns a Skill message into a skill for the loop, for one connected arm. What would not work is
// refused here, before anything moves.
class SkillBuilder {
 public:
  // `model` is this room's own. Limits as the loop has them.
  SkillBuilder(std::unique_ptr<realtime::Model> model, const models::Limits& limits);

  // `now`: the newest record, from where the skill will start. Throws Refused: unknown kinds, values out
  // of range, parts that do not fit each other, goals or paths out of the arm's reach.
  std::unique_ptr<realtime::Skill> build(const frankapy::proto::Skill& message, const realtime::Record& now);

 private:
  void check_joint_path(realtime::TrajectoryGenerator& trajectory, const std::string& kind) const;
  void check_cartesian_path(realtime::TrajectoryGenerator& trajectory, const std::string& kind,
                            const realtime::Record& now);

  std::unique_ptr<realtime::Model> model_;
  models::Limits limits_;
};

}  // namespace server
