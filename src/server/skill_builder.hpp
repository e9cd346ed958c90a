#pragma once

#include <memory>
#include <span>
#include <string>

#include "frankapy/proto/skill.pb.h"
#include "models/arm.hpp"
#include "realtime/door.hpp"
#include "realtime/model.hpp"

namespace server {

class WallStore;

// Turns a Skill message into a skill for the loop, for one connected arm. What would not work is
// refused here, before anything moves.
class SkillBuilder {
 public:
  // `model` is this room's own. Limits as the loop has them.
  SkillBuilder(std::unique_ptr<realtime::Model> model, const models::Limits& limits);

  // `now`: the newest record, from where the skill will start; of one that is queued, `after` is where the skill before
  // will end. `path`: whether to check the way of its trajectory, which has not begun yet. Throws Refused: unknown kinds, values out of range, parts that do not fit each other, goals or paths out of
  // the arm's reach.
  std::unique_ptr<realtime::Skill> build(const frankapy::proto::Skill& message, const realtime::Record& now,
                                         const realtime::Reference* after = nullptr, bool path = true);

  // From now on no way may lead through these walls, whose names `names` knows: it must outlive this; nor the arm, whose body they
  // have, into itself.
  void keep_from(std::unique_ptr<const realtime::Walls> walls, const WallStore& names);

 private:
  realtime::Vector7 joints_at_start(const realtime::Record& now, const realtime::Reference* after);
  realtime::Reference start_of(realtime::ReferenceKind kind, const realtime::Record& now, const realtime::Reference* after,
                               const realtime::Vector7& q);
  // Joints within their own limits may move EE faster than the robot allows: then the trajectory gets a slower clock. It has
  // started at `from`, and has afterwards.
  void keep_tool_speed(std::unique_ptr<realtime::TrajectoryGenerator>& trajectory, const realtime::Reference& from);
  void check_joint_path(realtime::TrajectoryGenerator& trajectory, const std::string& kind) const;
  // `q`: joints at its start, rad.
  void check_cartesian_path(realtime::TrajectoryGenerator& trajectory, const std::string& kind, realtime::Vector7 q);

  void check_joints_of_pose(const realtime::Vector7& q, const realtime::Reference& pose, const std::string& kind,
                            double percent) const;

  void check_bodies(std::span<const realtime::Vector7> way, const std::string& kind) const;

  std::unique_ptr<const realtime::Walls> walls_;
  const WallStore* wall_names_ = nullptr;
  std::unique_ptr<realtime::Model> model_;
  models::Limits limits_;
};

// The name of a robot controller.
frankapy::proto::RobotController name_of(const robot::Mode& mode);

}  // namespace server
