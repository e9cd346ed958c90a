#include "sim/arm_model.hpp"

#include <Eigen/Geometry>
#include <array>

namespace sim {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct Body {
  double mass = 0;
  Vector3d com = Vector3d::Zero();           // in the link's frame
  Matrix3d inertia = Matrix3d::Zero();       // about com, in the link's axes
};

Eigen::Isometry3d transform(const models::JointFrame& frame) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = (Eigen::AngleAxisd(frame.rpy[2], Vector3d::UnitZ()) *
                Eigen::AngleAxisd(frame.rpy[1], Vector3d::UnitY()) *
                Eigen::AngleAxisd(frame.rpy[0], Vector3d::UnitX()))
                   .toRotationMatrix();
  T.translation() = Vector3d(frame.xyz[0], frame.xyz[1], frame.xyz[2]);
  return T;
}

// Two bodies that are fixed to one another, both in the same frame.
Body joined(const Body& a, const Body& b) {
  Body sum;
  sum.mass = a.mass + b.mass;
  if (sum.mass == 0) return sum;
  sum.com = (a.mass * a.com + b.mass * b.com) / sum.mass;
  for (const Body* part : {&a, &b}) {
    const Vector3d r = part->com - sum.com;
    sum.inertia += part->inertia +
                   part->mass * (r.squaredNorm() * Matrix3d::Identity() - r * r.transpose());
  }
  return sum;
}

}  // namespace

struct ArmModel::Impl {
  std::array<Eigen::Isometry3d, 8> fixed;  // of each joint frame in the one before, at q = 0
  std::array<Body, 7> links;
  Body last_link;  // without the tool
  Eigen::Matrix4d O_T_F = Eigen::Matrix4d::Identity();
  std::array<Vector3d, 7> axis, origin;
  Matrix77 mass;
  Vector7 coriolis, gravity;
};

ArmModel::ArmModel(const models::Arm& arm) : impl_(std::make_unique<Impl>()) {
  for (int i = 0; i < 8; ++i) impl_->fixed[i] = transform(arm.joints[i]);
  for (int i = 0; i < 7; ++i) {
    const models::Link& link = arm.links[i + 1];
    const auto& I = link.inertia;
    Body& body = impl_->links[i];
    body.mass = link.mass;
    body.com = Vector3d(link.com[0], link.com[1], link.com[2]);
    body.inertia << I[0], I[3], I[4], I[3], I[1], I[5], I[4], I[5], I[2];
  }
  impl_->last_link = impl_->links[6];
  update(Vector7::Zero(), Vector7::Zero());
}

ArmModel::~ArmModel() = default;

void ArmModel::set_tool(double mass, const Vector3d& F_x_C, const Matrix3d& I) {
  const Eigen::Isometry3d& L_T_F = impl_->fixed[7];
  const Body tool{mass, L_T_F * F_x_C, L_T_F.linear() * I * L_T_F.linear().transpose()};
  impl_->links[6] = joined(impl_->last_link, tool);
}

void ArmModel::update(const Vector7& q, const Vector7& dq) {
  Impl& m = *impl_;
  std::array<Matrix3d, 7> I;
  std::array<Vector3d, 7> com;

  Matrix3d R = Matrix3d::Identity();
  Vector3d p = Vector3d::Zero();
  for (int i = 0; i < 7; ++i) {
    p += R * m.fixed[i].translation();
    R = R * m.fixed[i].linear();
    const double c = std::cos(q[i]), s = std::sin(q[i]);
    const Vector3d x = R.col(0), y = R.col(1);
    R.col(0) = c * x + s * y;
    R.col(1) = c * y - s * x;
    m.axis[i] = R.col(2);
    m.origin[i] = p;
    com[i] = p + R * m.links[i].com;
    I[i].noalias() = R * m.links[i].inertia * R.transpose();
  }
  m.O_T_F.topLeftCorner<3, 3>() = R * m.fixed[7].linear();
  m.O_T_F.topRightCorner<3, 1>() = p + R * m.fixed[7].translation();

  // Coriolis: recursive Newton-Euler in base axes with ddq = 0 and no gravity.
  std::array<Vector3d, 7> force, moment;
  Vector3d w = Vector3d::Zero(), dw = Vector3d::Zero(), a = Vector3d::Zero();
  Vector3d before = Vector3d::Zero();
  for (int i = 0; i < 7; ++i) {
    const Vector3d r = m.origin[i] - before;
    a += dw.cross(r) + w.cross(w.cross(r));
    dw += w.cross(m.axis[i] * dq[i]);
    w += m.axis[i] * dq[i];
    before = m.origin[i];
    const Vector3d d = com[i] - m.origin[i];
    force[i] = m.links[i].mass * (a + dw.cross(d) + w.cross(w.cross(d)));
    moment[i] = I[i] * dw + w.cross(I[i] * w);
  }
  Vector3d f = Vector3d::Zero(), n = Vector3d::Zero();
  double total = 0;
  constexpr double kGravity = 9.81;
  // Composite bodies from the hand inwards: mass, centre and inertia of all links beyond a joint.
  Vector3d composite_com = Vector3d::Zero();
  Matrix3d composite_inertia = Matrix3d::Zero();
  for (int i = 6; i >= 0; --i) {
    if (i < 6) n += (m.origin[i + 1] - m.origin[i]).cross(f);
    n += moment[i] + (com[i] - m.origin[i]).cross(force[i]);
    f += force[i];
    m.coriolis[i] = m.axis[i].dot(n);

    const double mass = m.links[i].mass;
    const Body sum = joined({total, composite_com, composite_inertia}, {mass, com[i], I[i]});
    total = sum.mass;
    composite_com = sum.com;
    composite_inertia = sum.inertia;

    const Vector3d lever = composite_com - m.origin[i];
    m.gravity[i] = m.axis[i].dot(lever.cross(Vector3d(0, 0, total * kGravity)));

    // Unit acceleration of joint i moves the composite with this force and moment.
    const Vector3d F = total * m.axis[i].cross(lever);
    const Vector3d N = composite_inertia * m.axis[i];
    for (int k = 0; k <= i; ++k) {
      m.mass(k, i) = m.mass(i, k) = m.axis[k].dot(N + (composite_com - m.origin[k]).cross(F));
    }
  }
}

const Eigen::Matrix4d& ArmModel::O_T_F() const { return impl_->O_T_F; }

ArmModel::Matrix67 ArmModel::jacobian(const Vector3d& F_p) const {
  const Vector3d p =
      impl_->O_T_F.topLeftCorner<3, 3>() * F_p + impl_->O_T_F.topRightCorner<3, 1>();
  Matrix67 J;
  for (int i = 0; i < 7; ++i) {
    J.col(i).head<3>() = impl_->axis[i].cross(p - impl_->origin[i]);
    J.col(i).tail<3>() = impl_->axis[i];
  }
  return J;
}

const ArmModel::Matrix77& ArmModel::mass() const { return impl_->mass; }
const ArmModel::Vector7& ArmModel::coriolis() const { return impl_->coriolis; }
const ArmModel::Vector7& ArmModel::gravity() const { return impl_->gravity; }

}  // namespace sim
