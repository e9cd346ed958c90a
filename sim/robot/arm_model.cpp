#include "sim/robot/arm_model.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "sim/robot/rotation.hpp"

namespace sim {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kGravity = 9.81;  // m/s², as in World


// Inertia about a point at -r from the centre of mass, less that about the centre: mass (r² 1 - r r^T).
Matrix3d steiner(double mass, const Vector3d& r) {
  return mass * (r.squaredNorm() * Matrix3d::Identity() - r * r.transpose());
}

}  // namespace

ArmModel::ArmModel(const models::Arm& arm) {
  for (int i = 0; i < 8; ++i) {
    const auto& [xyz, rpy] = arm.joints[i];
    frame_R_[i] = rotation_of_rpy(rpy);
    frame_p_[i] = Vector3d(xyz[0], xyz[1], xyz[2]);
  }
  for (int i = 0; i < 7; ++i) {
    const models::Link& link = arm.links[i + 1];
    const auto& I = link.inertia;
    links_[i].mass = link.mass;
    links_[i].com = Vector3d(link.com[0], link.com[1], link.com[2]);
    links_[i].inertia << I[0], I[3], I[4], I[3], I[1], I[5], I[4], I[5], I[2];
  }
  bodies_ = links_;
  update(Vector7::Zero(), Vector7::Zero());
}

void ArmModel::set_tool(double mass, const Vector3d& F_x_C, const Matrix3d& I) {
  const Body& link = links_[6];
  Body& body = bodies_[6];
  const Vector3d com = frame_R_[7] * F_x_C + frame_p_[7];
  body.mass = link.mass + mass;
  body.com = (link.mass * link.com + mass * com) / body.mass;
  body.inertia = link.inertia + steiner(link.mass, link.com - body.com) +
                 frame_R_[7] * I * frame_R_[7].transpose() + steiner(mass, com - body.com);
}

void ArmModel::update_kinematics(const Vector7& q) {
  Matrix3d R = Matrix3d::Identity();
  Vector3d p = Vector3d::Zero();
  for (int i = 0; i < 7; ++i) {
    p += R * frame_p_[i];
    const Matrix3d at_zero = R * frame_R_[i];
    const double c = std::cos(q[i]), s = std::sin(q[i]);
    R.col(0) = c * at_zero.col(0) + s * at_zero.col(1);
    R.col(1) = c * at_zero.col(1) - s * at_zero.col(0);
    R.col(2) = at_zero.col(2);
    R_[i] = R;
    p_[i] = p;
  }
  O_T_F_.setIdentity();
  O_T_F_.topLeftCorner<3, 3>() = R * frame_R_[7];
  O_T_F_.topRightCorner<3, 1>() = p + R * frame_p_[7];
}

void ArmModel::update(const Vector7& q, const Vector7& dq) {
  update_kinematics(q);

  // Spatial vectors are pairs about the origin of O: motion (angular, linear), force (moment, force).
  std::array<Vector3d, 7> S_w, S_v;  // the joints' motion
  std::array<Vector3d, 7> n, f;      // force that moves each body at ddq = 0 without gravity
  std::array<double, 7> m;           // composite bodies: mass, first moment, inertia about the origin
  std::array<Vector3d, 7> h;
  std::array<Matrix3d, 7> I;
  Vector3d w = Vector3d::Zero(), v = Vector3d::Zero();    // velocity of the body
  Vector3d dw = Vector3d::Zero(), dv = Vector3d::Zero();  // its acceleration
  for (int i = 0; i < 7; ++i) {
    S_w[i] = R_[i].col(2);
    S_v[i] = p_[i].cross(S_w[i]);
    dw += dq[i] * w.cross(S_w[i]);
    dv += dq[i] * (w.cross(S_v[i]) + v.cross(S_w[i]));
    w += dq[i] * S_w[i];
    v += dq[i] * S_v[i];

    const Body& body = bodies_[i];
    const Vector3d c = p_[i] + R_[i] * body.com;
    m[i] = body.mass;
    h[i] = body.mass * c;
    I[i] = R_[i] * body.inertia * R_[i].transpose() + steiner(body.mass, c);

    const Vector3d momentum = m[i] * v + w.cross(h[i]);
    const Vector3d moment = I[i] * w + h[i].cross(v);
    f[i] = m[i] * dv + dw.cross(h[i]) + w.cross(momentum);
    n[i] = I[i] * dw + h[i].cross(dv) + w.cross(moment) + v.cross(momentum);
  }
  for (int i = 6; i >= 0; --i) {
    coriolis_[i] = S_w[i].dot(n[i]) + S_v[i].dot(f[i]);
    // A body's weight at its centre is the moment h x g and the force m g about the origin.
    gravity_[i] = kGravity * (S_w[i].x() * h[i].y() - S_w[i].y() * h[i].x() + S_v[i].z() * m[i]);
    const Vector3d moment = I[i] * S_w[i] + h[i].cross(S_v[i]);
    const Vector3d momentum = m[i] * S_v[i] + S_w[i].cross(h[i]);
    for (int j = 0; j <= i; ++j) {
      mass_(i, j) = mass_(j, i) = S_w[j].dot(moment) + S_v[j].dot(momentum);
    }
    if (i > 0) {
      n[i - 1] += n[i];
      f[i - 1] += f[i];
      m[i - 1] += m[i];
      h[i - 1] += h[i];
      I[i - 1] += I[i];
    }
  }
}

ArmModel::Matrix67 ArmModel::jacobian(const Vector3d& F_p) const {
  const Vector3d O_p = O_T_F_.topLeftCorner<3, 3>() * F_p + O_T_F_.topRightCorner<3, 1>();
  Matrix67 J;
  for (int i = 0; i < 7; ++i) {
    J.col(i).head<3>() = R_[i].col(2).cross(O_p - p_[i]);
    J.col(i).tail<3>() = R_[i].col(2);
  }
  return J;
}

}  // namespace sim
