#include "frankapy/proto/controllers.pb.h"
#include "realtime/controllers/admittance.hpp"
#include "realtime/controllers/cartesian_impedance.hpp"
#include "realtime/controllers/force_axis_impedance.hpp"
#include "realtime/controllers/force_position.hpp"
#include "realtime/controllers/free_drive.hpp"
#include "realtime/controllers/hybrid_force_position.hpp"
#include "realtime/controllers/internal_impedance.hpp"
#include "realtime/controllers/joint_impedance.hpp"
#include "realtime/controllers/lqr.hpp"
#include "realtime/controllers/pass_through.hpp"
#include "realtime/controllers/pass_through_joint_torque.hpp"
#include "server/kinds/kind.hpp"

namespace server {
namespace {

template <class Message, class Make>
auto controller(Make make) {
  return kind<realtime::Controller, Message>(make);
}

realtime::CartesianImpedance::Frame frame(proto::CartesianImpedance::Frame of) {
  using Frame = realtime::CartesianImpedance::Frame;
  return of == proto::CartesianImpedance::BASE ? Frame::kBase : Frame::kEndEffector;
}

}  // namespace

std::vector<Kind<realtime::Controller>>& controllers() {
  static std::vector<Kind<realtime::Controller>> kinds = {
      controller<proto::JointImpedance>([](const auto& m, const auto& arm) {
        return new realtime::JointImpedance(
            {vector<7>(m.stiffness()), vector<7>(m.damping()), given(m.has_damping_ratio(), m.damping_ratio()),
             m.inertia_scale(), m.integral_rate(), m.integral_limit()},
            arm.model.mass());
      }),
      controller<proto::CartesianImpedance>([](const auto& m, const auto&) {
        return new realtime::CartesianImpedance({vector<3>(m.translational_stiffness()),
                                                 vector<3>(m.rotational_stiffness()), m.damping_ratio(),
                                                 m.nullspace_stiffness(), frame(m.frame()),
                                                 Eigen::Matrix3d::Identity(), given(m.has_topic(), m.topic()),
                                                 m.integral_rate(), vector<6>(m.integral_limit()), given<7>(m.posture())});
      }),
      controller<proto::FreeDrive>([](const auto& m, const auto&) {
        return new realtime::FreeDrive({vector<7>(m.damping()), vector<7>(m.friction())});
      }),
      controller<proto::Lqr>([](const auto& m, const auto& arm) {
        return new realtime::Lqr(
            {vector<7>(m.position_weight()), vector<7>(m.velocity_weight()), vector<7>(m.torque_weight())},
            arm.model.mass());
      }),
      controller<proto::Admittance>([](const auto& m, const auto&) {
        return new realtime::Admittance({vector<6>(m.mass()), vector<6>(m.damping()), vector<6>(m.stiffness()),
                                         m.translational_tracking(), m.rotational_tracking()});
      }),
      controller<proto::PassThrough>([](const auto& m, const auto&) {
        return new realtime::PassThrough({m.max_translation(), m.max_rotation()});
      }),
      controller<proto::ForceAxisImpedance>([](const auto& m, const auto&) {
        return new realtime::ForceAxisImpedance(
            {vector<3>(m.axis()), m.translational_stiffness(), m.rotational_stiffness(), m.max_translation()});
      }),
      controller<proto::PassThroughJointTorque>([](const auto& m, const auto& arm) {
        return new realtime::PassThroughJointTorque({vector<7>(m.torque()), vector<7>(m.selection()),
                                                     vector<7>(m.remove_gravity()), vector<7>(m.stiffness()),
                                                     vector<7>(m.damping()), given(m.has_topic(), m.topic()), m.timeout()},
                                                    arm.model.mass());
      }),
      controller<proto::ForcePosition>([](const auto& m, const auto& arm) {
        return new realtime::ForcePosition(
            {vector<6>(m.selection()), m.use_cartesian_gains(), vector<6>(m.position_kps_cart()),
             vector<6>(m.force_kps_cart()), vector<7>(m.position_kps_joint()), vector<7>(m.force_kps_joint()),
             m.max_speed(), given(m.has_topic(), m.topic())},
            arm.model.mass());
      }),
      controller<proto::HybridForcePosition>([](const auto& m, const auto&) {
        return new realtime::HybridForcePosition(
            {vector<6>(m.force_axes()), vector<6>(m.force()), frame(m.frame()), vector<3>(m.translational_stiffness()),
             vector<3>(m.rotational_stiffness()), m.damping_ratio(), m.nullspace_stiffness(), m.gain(), m.integral_gain(),
             m.max_speed(), m.max_turning_speed()});
      }),
      controller<proto::InternalImpedance>([](const auto& m, const auto&) {
        return new realtime::InternalImpedance({given<7>(m.k_theta()), given<6>(m.k_x())});
      }),
  };
  return kinds;
}

}  // namespace server
