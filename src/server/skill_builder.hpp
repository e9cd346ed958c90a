#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>

#include "frankapy/proto/skill.pb.h"
#include "models/arm.hpp"
#include "realtime/door.hpp"
#include "realtime/limiter.hpp"
#include "realtime/model.hpp"
#include "robot/collision_behavior.hpp"
#include "server/path_pace.hpp"

namespace server {

class WallStore;

// What a skill comes after.
struct Before {
  std::optional<realtime::Reference> end = {};  // of the skill that it is queued behind
  double speed = 1;                             // of the skill that runs
  bool lets_go = false;                         // its controller: the arm is where it was led
};

// Joints of the arm when parts of a skill were made, rad.
struct MadeAt {
  std::optional<realtime::Vector7> trajectory, controller;
};

// Turns a Skill message into a skill for the loop, for one connected arm. What would not work is
// refused here, before anything moves.
class SkillBuilder {
 public:
  // `model` is this room's own. Limits as the loop has them; `reflex`: the thresholds of the robot.
  SkillBuilder(std::unique_ptr<realtime::Model> model, const models::Limits& limits,
               const fci::SetCollisionBehavior& reflex = robot::kCollisionBehavior);

  // `now`: the newest record, from where the skill will start, unless `before` says otherwise. `made_at`: of the parts that a skill
  // which is changed keeps; those of the others are put there. The way of a trajectory that has not begun yet is checked. Throws
  // Refused: unknown kinds, values out of range, parts that do not fit each other, goals or paths out of the arm's reach.
  std::unique_ptr<realtime::Skill> build(const frankapy::proto::Skill& message, const realtime::Record& now, const Before& before,
                                         MadeAt& made_at);
  std::unique_ptr<realtime::Skill> build(const frankapy::proto::Skill& message, const realtime::Record& now) {
    MadeAt made_at;
    return build(message, now, {}, made_at);
  }

  // From now on no way may lead through these walls, whose names `names` knows: it must outlive this; nor the arm, whose body they
  // have, into itself.
  void keep_from(std::unique_ptr<const realtime::Walls> walls, const WallStore& names);

  // From now on builds for these limits, each at most the loop's.
  void keep_to(const models::Limits& limits);

  // As the loop has them.
  const models::Limits& limits_of_loop() const { return limits_of_loop_; }

 private:
  // How joints are made of poses: from these at their start (rad), by the robot, or by us and led near a posture.
  struct Elbow {
    realtime::Vector7 q;
    bool robots;
    std::optional<realtime::Vector7> posture;
  };

  realtime::Vector7 joints_at_start(const realtime::Record& now, const Before& before);
  realtime::Reference start_of(realtime::Channels motion, const realtime::Record& now, const Before& before,
                               const realtime::Vector7& q);
  // Checks the way of a trajectory that has started at `from`, as it looks in that cycle; where limits of the arm ask for it, it
  // then gets a slower pace, and has started again. `elbow`: who makes joints of the poses.
  void check_joint_path(std::unique_ptr<realtime::TrajectoryGenerator>& trajectory, const std::string& kind,
                        const realtime::Cycle& cycle, const realtime::Reference& from);
  void check_cartesian_path(std::unique_ptr<realtime::TrajectoryGenerator>& trajectory, const std::string& kind,
                            const realtime::Cycle& cycle, const realtime::Reference& from, const Elbow& elbow);

  // The joints with which the arm goes along such a path at so many places, checked, and how fast; in the time of `pace` if there
  // is one.
  SampledWay way_of_poses(realtime::TrajectoryGenerator& trajectory, int samples, const std::string& kind,
                          const realtime::Cycle& cycle, const Elbow& elbow, const realtime::Pace* pace);
  // The greatest share of its velocity that leaves the joints room to come to rest; 0 if there is none.
  double rate_with_room(realtime::Reference pose, const realtime::JointsOfPose& calm, bool robots);

  void check_is_led(const realtime::Vector7& q, const std::string& kind);
  void check_posture(const realtime::Skill& skill, const std::string& kind) const;
  void check_joints_of_pose(const realtime::JointsOfPose& joints, const realtime::Reference& pose, const std::string& kind,
                            double percent) const;

  void check_bodies(std::span<const realtime::Vector7> way, const std::string& kind) const;

  std::unique_ptr<const realtime::Walls> walls_;
  const WallStore* wall_names_ = nullptr;
  std::unique_ptr<realtime::Model> model_;
  fci::SetCollisionBehavior reflex_;
  models::Limits limits_of_loop_, limits_;
  std::unique_ptr<realtime::Limiter> limiter_;  // of no motion: it judges places of a path
};

// The name of a robot controller.
frankapy::proto::RobotController name_of(const robot::Mode& mode);

}  // namespace server
