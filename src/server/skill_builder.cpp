#include "server/skill_builder.hpp"

#include <spdlog/fmt/fmt.h>

#include <numbers>

#include "server/reachability.hpp"
#include "server/refused.hpp"
#include "server/registry.hpp"
#include "server/validation.hpp"

namespace server {
namespace {

using realtime::Reference;
using realtime::ReferenceKind;
using realtime::Vector7;

constexpr std::size_t kMaxDescription = 1024;  // bytes
constexpr int kMaxTerminations = 16;
constexpr int kPathSamples = 8;
// Where a limit is the goal: rounding on the way to it is no violation.
constexpr double kJointTolerance = 1e-6;  // rad

[[noreturn]] void refuse(const std::string& text) { throw Refused(proto::Error::INVALID_ARGUMENT, text); }

std::string name(ReferenceKind kind) {
  return kind == ReferenceKind::kJoint ? "joint references" : "Cartesian references";
}

void check_message(const proto::Skill& message) {
  if (message.description().size() > kMaxDescription) {
    refuse(fmt::format("Skill.description has {} bytes: expected at most {}", message.description().size(),
                       kMaxDescription));
  }
  if (!message.has_trajectory()) {
    refuse(fmt::format("Skill.trajectory is missing: expected one of {}", fmt::join(trajectory_kinds(), ", ")));
  }
  if (!message.has_controller()) {
    refuse(fmt::format("Skill.controller is missing: expected one of {}", fmt::join(controller_kinds(), ", ")));
  }
  if (message.terminations_size() > kMaxTerminations) {
    refuse(fmt::format("Skill.terminations has {} elements: expected at most {}", message.terminations_size(),
                       kMaxTerminations));
  }
}

// Where a trajectory of that kind would begin: the reference that is commanded now, else what is measured.
Reference start_of(ReferenceKind kind, const realtime::Record& now) {
  if (now.command.message_id != 0 && now.reference.kind == kind) return now.reference;
  Reference start;
  start.kind = kind;
  start.joint.q = Eigen::Map<const Vector7>(now.state.q.data());
  const Eigen::Isometry3d O_T_EE(Eigen::Map<const Eigen::Matrix4d>(now.state.O_T_EE.data()));
  start.cartesian.position = O_T_EE.translation();
  start.cartesian.orientation = Eigen::Quaterniond(O_T_EE.linear()).normalized();
  return start;
}

std::string text_of(const Reference& reference) {
  const auto numbers = [](const auto& v) {
    std::string text;
    for (double each : v) text += fmt::format("{}{:.4f}", text.empty() ? "" : ", ", each);
    return "[" + text + "]";
  };
  return reference.kind == ReferenceKind::kJoint ? numbers(reference.joint.q) + " rad"
                                                 : numbers(reference.cartesian.position) + " m";
}

Eigen::Isometry3d pose_of(const Reference& reference) {
  Eigen::Isometry3d pose(reference.cartesian.orientation);
  pose.translation() = reference.cartesian.position;
  return pose;
}

// Where of the way from start to goal, for people.
std::string place(int sample) {
  return sample == kPathSamples ? "its goal" : fmt::format("its path, {:.0f} % on", 100.0 * sample / kPathSamples);
}

}  // namespace

SkillBuilder::SkillBuilder(std::unique_ptr<realtime::Model> model, const models::Limits& limits)
    : model_(std::move(model)), limits_(limits) {}

std::unique_ptr<realtime::Skill> SkillBuilder::build(const proto::Skill& message, const realtime::Record& now) {
  check_message(message);
  auto skill = std::make_unique<realtime::Skill>();
  skill->trajectory = make_trajectory(message.trajectory(), limits_);
  skill->controller = make_controller(message.controller(), limits_);
  const std::string trajectory = kind_of(message.trajectory());
  const ReferenceKind kind = skill->trajectory->reference_kind();
  if (!skill->controller->accepts(kind)) {
    refuse(fmt::format("{} does not take the {} of {}: use {}, or another trajectory", kind_of(message.controller()),
                       name(kind), trajectory, controllers_that_accept(kind, limits_)));
  }
  for (const auto& any : message.terminations()) {
    auto termination = make_termination(any, limits_);
    if (!termination->accepts(kind)) {
      refuse(fmt::format("{} cannot judge the {} of {}: use {}", kind_of(any), name(kind), trajectory,
                         terminations_that_accept(kind, limits_)));
    }
    skill->terminations.push_back(std::move(termination));
  }
  skill->mode = skill->controller->mode(kind);
  skill->settings = skill->controller->settings();

  // The loop starts it again, from where the arm then is.
  skill->trajectory->start(start_of(kind, now));
  if (skill->trajectory->shortened()) {
    refuse(fmt::format("{}: its goal is beyond the arm's range; the nearest is {}", trajectory,
                       text_of(skill->trajectory->goal())));
  }
  if (kind == ReferenceKind::kJoint) {
    check_joint_path(*skill->trajectory, trajectory);
  } else {
    check_cartesian_path(*skill->trajectory, trajectory, now);
  }
  return skill;
}

void SkillBuilder::check_joint_path(realtime::TrajectoryGenerator& trajectory, const std::string& kind) const {
  const double duration = trajectory.duration();
  Reference reference;
  Vector7 outside;  // of the limits; an arm that begins there may come back
  for (int sample = 0; sample <= kPathSamples; ++sample) {
    trajectory.step(duration * sample / kPathSamples, reference);
    if (sample == kPathSamples) reference = trajectory.goal();
    for (int i = 0; i < 7; ++i) {
      const double q = reference.joint.q[i];
      const double excess = std::max(limits_.q_min[i] - q, q - limits_.q_max[i]);
      if (sample == 0) outside[i] = std::max(excess, 0.0);
      if (excess <= outside[i] + kJointTolerance) continue;
      refuse(fmt::format("{}: joint {} would be at {:.4f} rad at {}: expected {} to {} rad, the limits of this arm",
                         kind, i + 1, q, place(sample), limits_.q_min[i], limits_.q_max[i]));
    }
  }
}

void SkillBuilder::check_cartesian_path(realtime::TrajectoryGenerator& trajectory, const std::string& kind,
                                        const realtime::Record& now) {
  model_->set_tool(1, realtime::Vector3::Zero(), Eigen::Matrix3d::Identity(),
                   Eigen::Isometry3d(Eigen::Map<const Eigen::Matrix4d>(now.state.F_T_EE.data())));
  const double duration = trajectory.duration();
  const auto check = [&](int sample, const Eigen::Isometry3d& pose, const Vector7& from) {
    const Reach result = reach(*model_, limits_, pose, from);
    if (result.reached) return result.q;
    const auto text = [](const realtime::Vector3& v) { return fmt::format("[{:.4f}, {:.4f}, {:.4f}]", v[0], v[1], v[2]); };
    refuse(fmt::format("{}: {} is out of the arm's reach: position {} m in O. The nearest that the joints allow is "
                       "{} m, {:.1f} mm and {:.2f}° away: choose a pose nearer to the arm or another orientation",
                       kind, place(sample), text(pose.translation()), text(result.O_T_EE.translation()),
                       1e3 * result.distance, result.angle * 180 / std::numbers::pi));
  };
  Vector7 q = Eigen::Map<const Vector7>(now.state.q.data());
  Reference reference;
  // The goal first: it is what people ask for, and what to name when it is the goal that is wrong.
  check(kPathSamples, pose_of(trajectory.goal()), q);
  for (int sample = 1; sample < kPathSamples; ++sample) {
    trajectory.step(duration * sample / kPathSamples, reference);
    q = check(sample, pose_of(reference), q);
  }
}

}  // namespace server
