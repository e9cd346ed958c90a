#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include "frankapy/proto/trajectories.pb.h"
#include "realtime/trajectories/constant_velocity.hpp"
#include "realtime/trajectories/impulse.hpp"
#include "realtime/trajectories/joint_dmp.hpp"
#include "realtime/trajectories/joint_samples.hpp"
#include "realtime/trajectories/joint_waypoints.hpp"
#include "realtime/trajectories/linear_force_position.hpp"
#include "realtime/trajectories/min_jerk_joint.hpp"
#include "realtime/trajectories/min_jerk_pose.hpp"
#include "realtime/trajectories/pose_dmp.hpp"
#include "realtime/trajectories/pose_samples.hpp"
#include "realtime/trajectories/pose_waypoints.hpp"
#include "realtime/trajectories/quaternion_pose_dmp.hpp"
#include "realtime/trajectories/relative_linear_pose.hpp"
#include "realtime/trajectories/relative_min_jerk_joint.hpp"
#include "realtime/trajectories/relative_min_jerk_pose.hpp"
#include "realtime/trajectories/stay.hpp"
#include "realtime/trajectories/stream_force_position.hpp"
#include "realtime/trajectories/stream_joint.hpp"
#include "realtime/trajectories/stream_pose.hpp"
#include "realtime/trajectories/stream_velocity.hpp"
#include "realtime/trajectories/time_optimal_joint.hpp"
#include "realtime/trajectories/time_optimal_pose.hpp"
#include "realtime/trajectories/timed_joint.hpp"
#include "realtime/trajectories/timed_pose.hpp"
#include "server/kinds/kind.hpp"
#include "server/reachability.hpp"

namespace server {
namespace {

using Doubles = google::protobuf::RepeatedField<double>;
using realtime::TimeLaw;

template <class Message, class Make>
auto trajectory(Make make) {
  return kind<realtime::TrajectoryGenerator, Message>(make);
}

template <class Message>
auto timed_joint(TimeLaw law) {
  return trajectory<Message>([law](const auto& m, const auto& arm) {
    return new realtime::TimedJoint(law, {vector<7>(m.q()), m.duration()}, arm.limits);
  });
}
template <class Message>
auto timed_pose(TimeLaw law) {
  return trajectory<Message>([law](const auto& m, const auto& arm) {
    return new realtime::TimedPose(law, {vector<3>(m.position()), quaternion(m.quaternion()), m.duration()}, arm.limits);
  });
}

template <class Message>
realtime::PoseDifference difference(const Message& m) {
  using Frame = realtime::PoseDifference::Frame;
  return {vector<3>(m.translation()), quaternion(m.quaternion()),
          m.frame() == proto::RelativeMinJerkPose::BASE ? Frame::kBase : Frame::kEndEffector};
}

std::vector<double> list(const Doubles& field) { return {field.begin(), field.end()}; }

// A column for each row of the field.
template <int N>
Eigen::Map<const Eigen::Matrix<double, N, Eigen::Dynamic>> table(const Doubles& field) {
  return {field.data(), N, field.size() / N};  // its size was checked
}

// Of messages whose primitive has one force.
template <class Message>
realtime::DmpForce force(const Message& m) {
  return {list(m.mu()), list(m.h()), list(m.weights()), list(m.initial_sensor_values()), given(m.has_topic(), m.topic())};
}

template <class Message>
auto pose_dmp(realtime::FirstBasis first) {
  return trajectory<Message>([first](const auto& m, const auto& arm) {
    using Dimensions = realtime::PoseDmp::Dimensions;
    if (m.position_only() && m.orientation_only()) {
      throw std::invalid_argument("position_only and orientation_only are both true: expected at most one of them");
    }
    return new realtime::PoseDmp(first,
                                 {{m.tau(), m.alpha(), m.beta()},
                                  force(m),
                                  m.duration(),
                                  m.position_only()      ? Dimensions::kPosition
                                  : m.orientation_only() ? Dimensions::kOrientation
                                                         : Dimensions::kAll,
                                  m.ee_frame()},
                                 arm.limits);
  });
}

// Throws std::invalid_argument which names the first of these poses that no joints reach, of so many that are tried;
// each from the joints of the one before.
void require_reach(const std::string& what, const Doubles& position, const Doubles& quaternions,
                   const realtime::Arm& arm) {
  constexpr int kTried = 1000;
  constexpr int kPostures = 500;  // in some half of a second
  int postures = 0;
  const int count = position.size() / 3, step = std::max(1, count / kTried);
  realtime::Vector7 q = arm.q;
  std::string refusal;
  for (int k = 0; k < count && refusal.empty(); k += step) {
    const double* o = quaternions.data() + 4 * k;
    Eigen::Isometry3d pose(Eigen::Quaterniond(o[0], o[1], o[2], o[3]).normalized());
    pose.translation() = Eigen::Map<const Eigen::Vector3d>(position.data() + 3 * k);
    const Reach result = reach(arm.model, arm.limits, pose, q);
    q = result.q;
    postures += result.tried;
    if (!result.reached) {
      refusal = fmt::format("{} {} is out of the arm's reach by {:.1f} mm and {:.2f} rad: position [{:.4f}] m in O",
                            what, k, 1e3 * result.distance, result.angle, fmt::join(pose.translation(), ", "));
    } else if (postures > kPostures) {
      refusal = fmt::format("too many poses before {} {} are far from the one before them: expected a path, or fewer of them", what, k);
    }
  }
  arm.model.update(arm.q, realtime::Vector7::Zero());
  if (!refusal.empty()) throw std::invalid_argument(refusal);
}

}  // namespace

std::vector<Kind<realtime::TrajectoryGenerator>>& trajectories() {
  static std::vector<Kind<realtime::TrajectoryGenerator>> kinds = {
      trajectory<proto::MinJerkJoint>([](const auto& m, const auto& arm) {
        return new realtime::MinJerkJoint({vector<7>(m.q()), m.duration()}, arm.limits);
      }),
      trajectory<proto::RelativeMinJerkJoint>([](const auto& m, const auto& arm) {
        return new realtime::RelativeMinJerkJoint({vector<7>(m.delta_q()), m.duration()}, arm.limits);
      }),
      trajectory<proto::MinJerkPose>([](const auto& m, const auto& arm) {
        return new realtime::MinJerkPose({vector<3>(m.position()), quaternion(m.quaternion()), m.duration()}, arm.limits);
      }),
      trajectory<proto::RelativeMinJerkPose>([](const auto& m, const auto& arm) {
        return new realtime::RelativeMinJerkPose(difference(m), m.duration(), arm.limits);
      }),
      timed_joint<proto::LinearJoint>(TimeLaw::kLinear),
      timed_pose<proto::LinearPose>(TimeLaw::kLinear),
      trajectory<proto::RelativeLinearPose>([](const auto& m, const auto& arm) {
        return new realtime::RelativeLinearPose(difference(m), m.duration(), arm.limits);
      }),
      timed_joint<proto::CubicHermiteJoint>(TimeLaw::kCubicHermite),
      timed_pose<proto::CubicHermitePose>(TimeLaw::kCubicHermite),
      timed_joint<proto::SineJoint>(TimeLaw::kSine),
      timed_pose<proto::SinePose>(TimeLaw::kSine),
      trajectory<proto::StayJoint>([](const auto& m, const auto&) {
        return new realtime::Stay(realtime::Channels::kJoint, m.duration());
      }),
      trajectory<proto::StayPose>([](const auto& m, const auto&) {
        return new realtime::Stay(realtime::Channels::kPose, m.duration());
      }),
      trajectory<proto::JointVelocity>([](const auto& m, const auto& arm) {
        return new realtime::JointVelocity({vector<7>(m.dq()), given<7>(m.ddq()), m.duration()}, arm.limits);
      }),
      trajectory<proto::CartesianVelocity>([](const auto& m, const auto& arm) {
        const realtime::Vector6 twist = vector<6>(m.o_dp_ee());
        return new realtime::CartesianVelocity({twist, given<6>(m.o_ddp_ee()), m.duration()}, arm.limits,
                                               arm.model.joints_of_pose(arm.q).dq_dP * twist);
      }),
      trajectory<proto::TimeOptimalJoint>([](const auto& m, const auto& arm) {
        return new realtime::TimeOptimalJoint({vector<7>(m.q()), m.speed()}, arm.limits);
      }),
      trajectory<proto::TimeOptimalPose>([](const auto& m, const auto& arm) {
        return new realtime::TimeOptimalPose({vector<3>(m.position()), quaternion(m.quaternion()), m.speed()}, arm.limits);
      }),
      trajectory<proto::StreamJoint>([](const auto& m, const auto& arm) {
        return new realtime::StreamJoint(
            {m.topic(), given(m.has_delay(), m.delay()), given(m.has_timeout(), m.timeout()), m.speed()}, arm.limits);
      }),
      trajectory<proto::StreamPose>([](const auto& m, const auto& arm) {
        return new realtime::StreamPose(
            {m.topic(), given(m.has_delay(), m.delay()), given(m.has_timeout(), m.timeout()), m.speed()}, arm.limits);
      }),
      trajectory<proto::StreamForcePosition>([](const auto& m, const auto& arm) {
        return new realtime::StreamForcePosition(
            {m.topic(), given(m.has_delay(), m.delay()), given(m.has_timeout(), m.timeout()), m.speed()}, arm.limits);
      }),
      trajectory<proto::StreamJointVelocity>([](const auto& m, const auto& arm) {
        return new realtime::StreamJointVelocity({m.topic(), m.timeout(), m.speed()}, arm.limits);
      }),
      trajectory<proto::StreamCartesianVelocity>([](const auto& m, const auto& arm) {
        return new realtime::StreamCartesianVelocity({m.topic(), m.timeout(), m.speed()}, arm.limits);
      }),
      trajectory<proto::JointDmp>([](const auto& m, const auto& arm) {
        return new realtime::JointDmp({{m.tau(), m.alpha(), m.beta()}, force(m), m.duration()}, arm.limits);
      }),
      pose_dmp<proto::PoseDmp>(realtime::FirstBasis::kMinJerk),
      pose_dmp<proto::GoalPoseDmp>(realtime::FirstBasis::kGoal),
      trajectory<proto::QuaternionPoseDmp>([](const auto& m, const auto& arm) {
        return new realtime::QuaternionPoseDmp(
            {{m.position_tau(), m.position_alpha(), m.position_beta()},
             {list(m.position_mu()), list(m.position_h()), list(m.position_weights()), list(m.initial_sensor_values()),
              given(m.has_topic(), m.topic())},
             m.quat_alpha(),
             m.quat_beta(),
             {list(m.quat_mu()), list(m.quat_h()), list(m.quat_weights()), {}},
             quaternion(m.goal_quat()),
             m.goal_quat_time(),
             m.duration(),
             m.ee_frame()},
            arm.limits);
      }),
      trajectory<proto::Impulse>([](const auto& m, const auto&) {
        return new realtime::Impulse({vector<3>(m.force()), vector<3>(m.torque()), m.acc_duration(), m.duration()});
      }),
      trajectory<proto::LinearForcePosition>([](const auto& m, const auto& arm) {
        return new realtime::LinearForcePosition({{vector<3>(m.position()), quaternion(m.quaternion()), m.duration()},
                                                  vector<3>(m.force()),
                                                  vector<3>(m.torque())},
                                                 arm.limits);
      }),
      trajectory<proto::JointWaypoints>([](const auto& m, const auto& arm) {
        const auto q = table<7>(m.q());
        return new realtime::JointWaypoints({{q.colwise().begin(), q.colwise().end()}, list(m.times()), m.speed()},
                                            arm.limits, arm.q);
      }),
      trajectory<proto::PoseWaypoints>([](const auto& m, const auto& arm) {
        const auto position = table<3>(m.position());
        const auto orientation = table<4>(m.quaternion());
        realtime::PoseWaypoints::Parameters parameters{
            {position.colwise().begin(), position.colwise().end()}, {}, list(m.times()), m.speed()};
        for (const auto& o : orientation.colwise()) parameters.orientation.emplace_back(o[0], o[1], o[2], o[3]);
        auto made = std::make_unique<realtime::PoseWaypoints>(parameters, arm.limits, arm.model.O_T_EE());
        require_reach("waypoint", m.position(), m.quaternion(), arm);
        return made.release();
      }),
      trajectory<proto::JointSamples>([](const auto& m, const auto& arm) {
        return new realtime::JointSamples(table<7>(m.q()), arm.limits, arm.q);
      }),
      trajectory<proto::PoseSamples>([](const auto& m, const auto& arm) {
        auto made = std::make_unique<realtime::PoseSamples>(table<3>(m.position()), table<4>(m.quaternion()),
                                                            arm.limits, arm.model.O_T_EE());
        require_reach("sample", m.position(), m.quaternion(), arm);
        return made.release();
      }),
  };
  return kinds;
}

}  // namespace server
