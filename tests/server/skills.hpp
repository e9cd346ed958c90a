#pragma once

#include <memory>

#include "frankapy/proto/controllers.pb.h"
#include "frankapy/proto/service.pb.h"
#include "frankapy/proto/skill.pb.h"
#include "frankapy/proto/terminations.pb.h"
#include "frankapy/proto/trajectories.pb.h"
#include "models/arm.hpp"
#include "server/skill_builder.hpp"

// An FR3 at home, and messages for it.
namespace server {

namespace proto = frankapy::proto;

inline const models::Limits& fr3_limits() { return models::limits(models::arm("fr3"), 10); }

inline std::unique_ptr<realtime::Model> fr3_model() {
  return std::make_unique<realtime::Model>(models::urdf(models::arm("fr3"), 10));
}

// The robot holds itself at home, a tool at its flange that is 0.1 m long.
inline realtime::Record record_at_home() {
  const auto model = fr3_model();
  realtime::Record record;
  record.phase = realtime::Phase::kIdle;
  record.cycles = 1;
  record.state.message_id = 1;
  record.state.q = record.state.q_d = models::kHome;
  record.state.F_T_EE[14] = 0.1;
  Eigen::Isometry3d F_T_EE = Eigen::Isometry3d::Identity();
  F_T_EE.translation().z() = 0.1;
  const Eigen::Isometry3d O_T_F = model->O_T_EE(Eigen::Map<const realtime::Vector7>(models::kHome.data()));
  Eigen::Map<Eigen::Matrix4d>(record.state.O_T_EE.data()) = (O_T_F * F_T_EE).matrix();
  return record;
}

inline proto::Skill skill_of(const google::protobuf::Message& trajectory, const google::protobuf::Message& controller) {
  proto::Skill skill;
  skill.mutable_trajectory()->PackFrom(trajectory);
  skill.mutable_controller()->PackFrom(controller);
  return skill;
}

inline proto::MinJerkJoint joint_motion(int joint = 0, double by = 0.1) {
  proto::MinJerkJoint message;
  for (int i = 0; i < 7; ++i) message.add_q(models::kHome[i] + (i == joint ? by : 0));
  return message;
}

inline proto::RelativeMinJerkPose pose_motion(double x, double y, double z) {
  proto::RelativeMinJerkPose message;
  for (double each : {x, y, z}) message.add_translation(each);
  message.set_frame(proto::RelativeMinJerkPose::BASE);
  return message;
}

}  // namespace server
