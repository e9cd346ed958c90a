#include "server/skill_builder.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "realtime/pose_joints.hpp"
#include "realtime/rotation.hpp"
#include "realtime/tool.hpp"
#include "server/part_record.hpp"
#include "server/reachability.hpp"
#include "server/refused.hpp"
#include "server/registry.hpp"
#include "server/self_collision.hpp"
#include "server/wall_store.hpp"

namespace server {
namespace {

using realtime::Channels;
using realtime::Reference;
using realtime::TrajectoryGenerator;
using realtime::Vector7;

constexpr std::size_t kMaxDescription = 1024;  // bytes
constexpr int kMostTerminations = 16;
constexpr int kPathSamples = 8;
// Between the places of a way that are looked at, about: s, and as far as kEnoughSamples go m and rad.
constexpr double kSampleTime = 0.02, kSampleLength = 0.002;
constexpr int kLeastSamples = 20, kEnoughSamples = 100;
constexpr int kMostJointSamples = 100'000, kMostPoseSamples = 2'500;  // 0.06 s and 0.01 s, with 31 walls
constexpr int kSteps = 3;     // of inverse kinematics from one place to the next, of a way of poses
constexpr int kFirstSteps = 20;  // to its first, which an arm is beside that does not follow exactly; at most
constexpr double kStill = 1e-9;  // rad: a step that leads nowhere
constexpr double kMissed = 5e-3;         // m, rad
constexpr double kToolSpeedShare = 0.94;  // the rest is for what the arm does beside its reference
constexpr double kPoseShare = 0.7;        // of the joints' limits of acceleration and jerk, for a way of poses
constexpr double kRoomShare = 0.97;       // of the greatest rate that the limiter would let pass
constexpr double kSlowestPath = 0.02;     // at which a path is gone along
constexpr double kFarStart = 60, kLateStart = 1;  // s
// Where a limit is the goal: rounding on the way to it is no violation.
constexpr double kJointTolerance = 1e-6;  // rad

std::string name(Channels channels) {
  std::string text = has(channels, Channels::kJoint) ? "joint references" : "Cartesian references";
  if (has(channels, Channels::kWrench)) text += " with a wrench";
  if (has(channels, Channels::kTorque)) text += " with torques";
  return text;
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
  if (message.terminations_size() > kMostTerminations) {
    refuse(fmt::format("Skill.terminations has {} elements: expected at most {}", message.terminations_size(),
                       kMostTerminations));
  }
}

std::string text_of(const Reference& reference) {
  const auto numbers = [](const auto& v) {
    std::string text;
    for (double each : v) text += fmt::format("{}{:.4f}", text.empty() ? "" : ", ", each);
    return "[" + text + "]";
  };
  return reference.motion == Channels::kJoint ? numbers(reference.joint.q) + " rad"
                                              : numbers(reference.cartesian.position) + " m";
}

// Where of the way from start to goal, after that share of its duration, for people.
std::string place(double share) { return share == 1 ? "its goal" : fmt::format("its path, {:.0f} % on", 100 * share); }
std::string place(int sample) { return place(static_cast<double>(sample) / kPathSamples); }

constexpr const char* kOtherWay = "go there by joints (goto_joints), or begin from a posture farther from it";

// `length`: m and rad together, of all joints or of translation and rotation.
int samples_of(double duration, double length, int most) {
  const double places = std::max(duration / kSampleTime, std::min(length / kSampleLength, 1. * kEnoughSamples));
  return static_cast<int>(std::clamp(places, 1. * kLeastSamples, 1. * most));
}

// It has started at `from`, and has afterwards.
void slow_down(std::unique_ptr<TrajectoryGenerator>& trajectory, std::optional<realtime::Pace> pace, const Reference& from) {
  if (!pace) return;
  trajectory = std::make_unique<realtime::Paced>(std::move(trajectory), *std::move(pace));
  trajectory->start(from);
}

// On CLOCK_MONOTONIC, of a time on this computer's clock, s since 1970.
std::int64_t start_ns(double start_time) {
  const double ahead = start_time - std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
  if (!(ahead > -kLateStart && ahead < kFarStart)) {
    refuse(fmt::format("Skill.start_time is {:.3f} s {} by the server's clock: expected at most {:.0f} s ahead. Do the clocks of "
                       "both computers agree?",
                       std::abs(ahead), ahead < 0 ? "in the past" : "ahead", kFarStart));
  }
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::nanoseconds(now).count() + std::llround(1e9 * ahead);
}

using Generator = fci::MotionGeneratorMode;

// A robot controller that has a name of its own.
struct Named {
  proto::RobotController name;
  bool torque;  // ours, else the robot's own impedance
  Generator generator;
};
constexpr std::array<Named, 9> kRobotControllers = {{
    {proto::TORQUE, true, Generator::kNone},
    {proto::JOINT_POSITION, false, Generator::kJointPosition},
    {proto::JOINT_VELOCITY, false, Generator::kJointVelocity},
    {proto::CARTESIAN_POSE, false, Generator::kCartesianPosition},
    {proto::CARTESIAN_VELOCITY, false, Generator::kCartesianVelocity},
    {proto::TORQUE_AND_JOINT_POSITION, true, Generator::kJointPosition},
    {proto::TORQUE_AND_JOINT_VELOCITY, true, Generator::kJointVelocity},
    {proto::TORQUE_AND_CARTESIAN_POSE, true, Generator::kCartesianPosition},
    {proto::TORQUE_AND_CARTESIAN_VELOCITY, true, Generator::kCartesianVelocity},
}};

// The rule of what fits: controllers of ours make torques, the robot's own impedance follows the robot's reference. That is
// the trajectory's motion; of a pose the robot makes joints, which a controller may follow instead.
bool fits(const Named& named, const realtime::Controller& controller, Channels filled) {
  const Channels motion = motion_of(filled);
  const robot::Mode mode = {controller.mode(motion).controller, named.generator};
  if (mode.torque() != named.torque || (mode.motion() && !controller.tracks())) return false;
  if (mode.motion() && mode.cartesian() != (motion == Channels::kPose)) return false;
  Channels takes = controller.takes();
  if (mode.torque() && mode.cartesian() && has(takes, Channels::kJoint)) takes = takes | Channels::kPose;
  return has(takes, filled);
}

robot::Mode choose(const proto::Skill& message, const realtime::Controller& controller,
                   const TrajectoryGenerator& generator, const realtime::Arm& arm) {
  const Channels filled = generator.fills();
  std::string fitting;
  for (const Named& each : kRobotControllers) {
    if (!fits(each, controller, filled)) continue;
    if (message.robot_controller() == proto::AUTO || message.robot_controller() == each.name) {
      return {controller.mode(motion_of(filled)).controller, each.generator};
    }
    fitting += (fitting.empty() ? "" : ", ") + proto::RobotController_Name(each.name);
  }
  const std::string trajectory = kind_of(message.trajectory());
  if (fitting.empty()) {
    refuse(fmt::format("{} does not take the {} of {}: use {}, or another trajectory", kind_of(message.controller()),
                       name(filled), trajectory, controllers_that_take(filled, arm)));
  }
  refuse(fmt::format("the robot controller {} does not fit {} with the {} of {}: use {}",
                     proto::RobotController_Name(message.robot_controller()), kind_of(message.controller()),
                     name(filled), trajectory, fitting));
}

// Whether the arm can do that where a contact ends the skill.
void check_ending(const realtime::SoftEnding& then, const realtime::Skill& skill, const std::string& kind) {
  if (then.what == realtime::AfterContact::kComplied && skill.mode != robot::kTorque) {
    refuse(fmt::format("Contact.then is Comply, and with the robot controller {} the robot moves a reference with a stiffness that "
                       "cannot be changed meanwhile: use TORQUE, or BackOff",
                       proto::RobotController_Name(name_of(skill.mode))));
  }
  if (then.what == realtime::AfterContact::kBackedOff && !skill.controller->leads()) {
    refuse(fmt::format("Contact.then is BackOff, and {} does not lead all of the arm, so that it would not bring it back: use "
                       "Comply, or another controller",
                       kind));
  }
}

}  // namespace

proto::RobotController name_of(const robot::Mode& mode) {
  const auto found = std::find_if(kRobotControllers.begin(), kRobotControllers.end(), [&](const Named& each) {
    return each.torque == mode.torque() && each.generator == mode.generator;
  });
  return found->name;
}

SkillBuilder::SkillBuilder(std::unique_ptr<realtime::Model> model, const models::Limits& limits,
                           const fci::SetCollisionBehavior& reflex)
    : model_(std::move(model)),
      reflex_(reflex),
      limits_of_loop_(limits),
      limits_(limits),
      limiter_(std::make_unique<realtime::Limiter>(limits)) {}

std::unique_ptr<realtime::Skill> SkillBuilder::build(const proto::Skill& message, const realtime::Record& now,
                                                     const Before& before, MadeAt& made_at) {
  check_message(message);
  realtime::carry(now.state, *model_);
  const auto arm_at = [this](const Vector7& q) {
    model_->update(q, Vector7::Zero());
    return realtime::Arm{limits_, *model_, q, reflex_};
  };
  const Vector7 q = joints_at_start(now, before);
  const bool has_begun = made_at.trajectory.has_value();
  if (!has_begun) made_at.trajectory = q;
  if (!made_at.controller) made_at.controller = q;
  auto skill = std::make_unique<realtime::Skill>();
  skill->trajectory = make_trajectory(message.trajectory(), arm_at(*made_at.trajectory));
  skill->speed = message.speed();
  skill->controller = make_controller(message.controller(), arm_at(*made_at.controller));
  const realtime::Arm arm = arm_at(q);
  const std::string trajectory = kind_of(message.trajectory());
  const Channels filled = skill->trajectory->fills(), motion = motion_of(filled);
  skill->numbers = {number_of(trajectory), number_of(kind_of(message.controller())), {}};
  skill->mode = choose(message, *skill->controller, *skill->trajectory, arm);
  check_posture(*skill, kind_of(message.controller()));
  for (const auto& any : message.terminations()) {
    auto termination = make_termination(any, arm);
    if (!has(filled, termination->judges())) {
      refuse(fmt::format("{} cannot judge the {} of {}: use {}", kind_of(any), name(filled), trajectory,
                         terminations_that_judge(filled, arm)));
    }
    if (const auto* then = termination->then()) check_ending(*then, *skill, kind_of(message.controller()));
    skill->terminations.push_back(std::move(termination));
    skill->numbers.terminations.push_back(number_of(kind_of(any)));
  }
  skill->settings = skill->controller->settings();
  if (message.has_start_time()) skill->start_ns = start_ns(message.start_time());
  if (has_begun) return skill;
  const InPart in_part(skill->numbers.trajectory);
  // The loop starts it again, from where the arm then is.
  realtime::Cycle cycle{now.state, *model_};
  cycle.q = Eigen::Map<const Vector7>(now.state.q.data());
  cycle.dq = Eigen::Map<const Vector7>(now.state.dq.data());
  cycle.O_T_EE = realtime::pose(now.state.O_T_EE);
  if (skill->mode.cartesian()) check_is_led(arm.q, trajectory);
  const Reference start = skill->start_from(start_of(motion, now, before, arm.q), before.speed);
  skill->trajectory->start(start);
  if (skill->trajectory->shortened()) {
    refuse(fmt::format("{}: its goal is beyond the arm's range; the nearest is {}", trajectory,
                       text_of(skill->trajectory->goal())));
  }
  if (motion == Channels::kJoint) {
    check_joint_path(skill->trajectory, trajectory, cycle, start);
  } else {
    check_cartesian_path(skill->trajectory, trajectory, cycle, start, {arm.q, skill->mode.cartesian(), skill->controller->posture()});
  }
  return skill;
}

// That the robot's joints may go along with a pose from there.
void SkillBuilder::check_is_led(const Vector7& q, const std::string& kind) {
  if (std::abs(model_->joints_of_pose(q).determinant) >= realtime::Limiter::kSingular) return;
  refuse(fmt::format("{}: the arm is in a singular posture, [{:.4f}] rad, from which the robot's own joints cannot follow a pose: go "
                     "away from it by joints first (goto_joints), or use the robot controller TORQUE",
                     kind, fmt::join(q, ", ")));
}

void SkillBuilder::check_posture(const realtime::Skill& skill, const std::string& kind) const {
  const auto posture = skill.controller->posture();
  if (!posture) return;
  if (skill.mode.cartesian()) {
    refuse(fmt::format("{}: posture is given, and with the robot controller {} the robot makes the joints of a pose: use TORQUE", kind,
                       proto::RobotController_Name(name_of(skill.mode))));
  }
  for (int i = 0; i < models::kJoints; ++i) {
    const double q = (*posture)[i];
    if (q >= limits_.q_min[i] && q <= limits_.q_max[i]) continue;
    refuse(fmt::format("{}: posture[{}] is {} rad: expected {} to {} rad, the limits of this arm", kind, i, q, limits_.q_min[i],
                       limits_.q_max[i]));
  }
}

// Where the skill before ends; else as measured.
Vector7 SkillBuilder::joints_at_start(const realtime::Record& now, const Before& before) {
  const Vector7 q = Eigen::Map<const Vector7>(now.state.q.data());
  if (!before.end) return q;
  if (before.end->motion == Channels::kJoint) return before.end->joint.q;
  return reach(*model_, limits_, realtime::frame(before.end->cartesian), q).q;
}

// Where such a motion will begin: where the one before ends; else the reference that is commanded now; else what is measured.
Reference SkillBuilder::start_of(Channels motion, const realtime::Record& now, const Before& before, const Vector7& q) {
  if (!before.end && !before.lets_go && now.command.message_id != 0 && now.reference.motion == motion) return now.reference;
  Eigen::Isometry3d O_T_EE = realtime::pose(now.state.O_T_EE);
  if (before.end) O_T_EE = before.end->motion == Channels::kJoint ? model_->O_T_EE(q) : realtime::frame(before.end->cartesian);
  Reference start;
  start.motion = motion;
  start.joint.q = q;
  start.cartesian.position = O_T_EE.translation();
  start.cartesian.orientation = Eigen::Quaterniond(O_T_EE.linear()).normalized();
  return start;
}

void SkillBuilder::check_joint_path(std::unique_ptr<TrajectoryGenerator>& trajectory, const std::string& kind,
                                    const realtime::Cycle& cycle, const Reference& from) {
  const double duration = trajectory->duration();
  Reference reference;
  Vector7 outside;  // of the limits; an arm that begins there may come back
  const auto look = [&](double share) {
    for (int i = 0; i < 7; ++i) {
      const double q = reference.joint.q[i];
      const double excess = std::max(limits_.q_min[i] - q, q - limits_.q_max[i]);
      if (share == 0) outside[i] = std::max(excess, 0.0);
      if (excess <= outside[i] + kJointTolerance) continue;
      refuse(fmt::format("{}: joint {} would be at {:.4f} rad at {}: expected {} to {} rad, the limits of this arm",
                         kind, i + 1, q, place(share), limits_.q_min[i], limits_.q_max[i]));
    }
  };
  Vector7 before = from.joint.q;
  double length = 0;
  for (int sample = 0; sample <= kPathSamples; ++sample) {
    trajectory->step(cycle, duration * sample / kPathSamples, reference);
    if (sample == kPathSamples) reference = trajectory->goal();
    length += (reference.joint.q - before).lpNorm<1>();
    before = reference.joint.q;
    look(static_cast<double>(sample) / kPathSamples);
  }
  if (!trajectory->has_end()) return;
  // Joints within their own limits may move EE faster than the robot allows: then they are slowed down there.
  SampledWay way{duration, {}, {}};
  const int samples = samples_of(duration, length, kMostJointSamples);
  realtime::Vector3 last;
  for (int sample = 0; sample <= samples; ++sample) {
    trajectory->step(cycle, duration * sample / samples, reference);
    if (sample > 0) look(static_cast<double>(sample) / samples);
    const realtime::Vector3 here = model_->O_T_EE(reference.joint.q).translation();
    const double speed = sample == 0 ? 0 : (here - last).norm() * samples / duration;
    last = here;
    way.q.push_back(reference.joint.q);
    way.rate.push_back(kToolSpeedShare * limits_.translation.velocity / std::max(speed, 1e-9));
  }
  slow_down(trajectory, pace_along(way, limits_, std::numeric_limits<double>::infinity()), from);
  way.q.push_back(trajectory->goal().joint.q);
  check_bodies(way.q, kind);
}

// The arm's own, and walls.
void SkillBuilder::check_bodies(std::span<const Vector7> way, const std::string& kind) const {
  if (!walls_) return;
  check_self_collision(walls_->arm, way, kind);
  check_walls(*walls_, *wall_names_, way, kind);
}

void SkillBuilder::check_cartesian_path(std::unique_ptr<TrajectoryGenerator>& trajectory, const std::string& kind,
                                        const realtime::Cycle& cycle, const Reference& from, const Elbow& elbow) {
  const double duration = trajectory->duration();
  const auto check = [&](int sample, const Eigen::Isometry3d& pose, const Vector7& from) {
    const Reach result = reach(*model_, limits_, pose, from);
    if (result.reached) return result.q;
    const auto text = [](const realtime::Vector3& v) { return fmt::format("[{:.4f}, {:.4f}, {:.4f}]", v[0], v[1], v[2]); };
    refuse(fmt::format("{}: {} is out of the arm's reach: position {} m in O. The nearest that the joints allow is "
                       "{} m, {:.1f} mm and {:.2f}° away: choose a pose nearer to the arm or another orientation",
                       kind, place(sample), text(pose.translation()), text(result.O_T_EE.translation()),
                       1e3 * result.distance, result.angle * 180 / std::numbers::pi));
  };
  Reference reference;
  // The goal first: it is what people ask for, and what to name when it is the goal that is wrong.
  check(kPathSamples, realtime::frame(trajectory->goal().cartesian), elbow.q);
  Vector7 reached = elbow.q;
  realtime::CartesianReference before = from.cartesian;
  double length = 0;
  const auto pass = [&](const Reference& here) {
    const realtime::Vector6 way = realtime::change_between(before, here.cartesian);
    length += way.head<3>().norm() + way.tail<3>().norm();
    before = here.cartesian;
  };
  for (int sample = 1; sample < kPathSamples; ++sample) {
    trajectory->step(cycle, duration * sample / kPathSamples, reference);
    reached = check(sample, realtime::frame(reference.cartesian), reached);
    pass(reference);
  }
  pass(trajectory->goal());
  if (!trajectory->has_end()) return;
  // Every pose of it is reached by some joints; now those with which the arm goes from one to the next. The elbow gives way in the
  // time that it has, so that a way which gets another pace is gone along once more.
  const int samples = samples_of(duration, length, kMostPoseSamples);
  SampledWay way = way_of_poses(*trajectory, samples, kind, cycle, elbow, nullptr);
  auto pace = pace_along(way, limits_, kPoseShare);
  if (pace) {
    way = way_of_poses(*trajectory, samples, kind, cycle, elbow, &*pace);
    pace = pace_along(way, limits_, kPoseShare);
  }
  slow_down(trajectory, std::move(pace), from);
  check_bodies(way.q, kind);
}

SampledWay SkillBuilder::way_of_poses(TrajectoryGenerator& trajectory, int samples, const std::string& kind,
                                      const realtime::Cycle& cycle, const Elbow& elbow, const realtime::Pace* pace) {
  SampledWay way{trajectory.duration(), {}, {}};
  realtime::PoseJoints joints(*model_, limits_);
  joints.place(elbow.q);
  joints.prefer(elbow.posture);
  Reference reference;
  for (int sample = 0; sample <= samples; ++sample) {
    trajectory.step(cycle, way.duration * sample / samples, reference);
    if (sample == samples) reference = trajectory.goal();
    const std::size_t k = static_cast<std::size_t>(sample);
    const double time = sample == 0 ? 0 : pace ? pace->places[k].time - pace->places[k - 1].time : way.duration / samples;
    const int steps = sample == 0 ? kFirstSteps : kSteps;
    for (int step = 0; step < steps; ++step) {
      const Vector7 before = joints.joints().q;
      joints.step(reference.cartesian, elbow.robots ? 0 : time / steps);  // a robot's elbow stays
      if (sample == 0 && (joints.joints().q - before).norm() < kStill) break;
    }
    const realtime::JointsOfPose& here = joints.joints();
    check_joints_of_pose(here, reference, kind, 100. * sample / samples);
    way.q.push_back(here.q);
    way.rate.push_back(rate_with_room(reference, here, elbow.robots));
    if (way.rate.back() > 0) continue;
    refuse(fmt::format("{}: {:.0f} % on, its path leads too near to a singular posture of the arm or to the end of a joint's range "
                       "to come to rest before it, [{:.4f}] rad; {}",
                       kind, 100. * sample / samples, fmt::join(here.q, ", "), kOtherWay));
  }
  return way;
}

double SkillBuilder::rate_with_room(Reference pose, const realtime::JointsOfPose& calm, bool robots) {
  const double damping = robots ? realtime::Model::kNoDamping : realtime::Model::kCalm;
  const realtime::JointsOfPose joints = robots ? model_->joints_of_pose(calm.q, damping) : calm;
  const realtime::Vector6 velocity = pose.cartesian.velocity;
  pose.cartesian.acceleration.setZero();
  const auto has_room = [&](double rate) {
    pose.cartesian.velocity = rate * velocity;
    limiter_->reset(pose);
    limiter_->joints_follow(joints, joints, robots);
    limiter_->joints_follow(joints, model_->joints_of_pose(limiter_->joints_ahead(joints.q), damping), robots);
    return limiter_->has_room();
  };
  if (has_room(1 / kRoomShare)) return 1;
  double most = 1 / kRoomShare, least = kSlowestPath;
  if (!has_room(least)) return 0;
  constexpr int kHalvings = 7;
  for (int n = 0; n < kHalvings; ++n) {
    const double rate = std::sqrt(most * least);
    (has_room(rate) ? least : most) = rate;
  }
  return kRoomShare * least;
}

// Joints with which the arm would come to a pose on its path, `percent` of the way on.
void SkillBuilder::check_joints_of_pose(const realtime::JointsOfPose& joints, const Reference& pose, const std::string& kind,
                                        double percent) const {
  const Vector7& q = joints.q;
  for (int i = 0; i < models::kJoints; ++i) {
    if (q[i] >= limits_.q_min[i] && q[i] <= limits_.q_max[i]) continue;
    refuse(fmt::format("{}: {:.0f} % on, its path would lead joint {} to {:.4f} rad: expected {} to {} rad, the limits of this "
                       "arm; {}",
                       kind, percent, i + 1, q[i], limits_.q_min[i], limits_.q_max[i], kOtherWay));
  }
  const realtime::Vector6 left = realtime::change_between(realtime::at(joints.O_T_EE), pose.cartesian);
  if (left.head<3>().norm() > kMissed || left.tail<3>().norm() > kMissed) {
    refuse(fmt::format("{}: {:.0f} % on, its path leads through a singular posture of the arm, [{:.4f}] rad; {}", kind, percent,
                       fmt::join(q, ", "), kOtherWay));
  }
}

void SkillBuilder::keep_to(const models::Limits& limits) {
  limits_ = limits;
  limiter_ = std::make_unique<realtime::Limiter>(limits);
}

void SkillBuilder::keep_from(std::unique_ptr<const realtime::Walls> walls, const WallStore& names) {
  walls_ = std::move(walls);
  wall_names_ = &names;
}

}  // namespace server
