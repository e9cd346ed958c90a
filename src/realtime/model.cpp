#include "realtime/model.hpp"

#include <array>
#include <cmath>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/model.hpp>
#include <pinocchio/parsers/urdf.hpp>
#include <stdexcept>
#include <vector>

#include "realtime/cholesky.hpp"

namespace realtime {
namespace {

constexpr int kJoints = 7;

using Matrix6 = Eigen::Matrix<double, 6, 6>;

// The type that Pinocchio's library is compiled for: with any other its templates compile here, for minutes.
using In = Eigen::Ref<const Eigen::VectorXd>;

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

std::string list(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

pinocchio::Model parse(const std::string& urdf) {
  pinocchio::Model model;
  try {
    pinocchio::urdf::buildModelFromXML(urdf, model);
  } catch (const std::exception& error) {
    throw std::invalid_argument(std::string("the robot's URDF cannot be read: ") + error.what());
  }
  return model;
}

// The body frame of link `number` of the arm, whatever its prefix.
pinocchio::FrameIndex link(const pinocchio::Model& model, int number) {
  const std::string name = "link" + std::to_string(number);
  std::vector<std::string> links;
  for (pinocchio::FrameIndex i = 0; i < model.frames.size(); ++i) {
    if (model.frames[i].type != pinocchio::BODY) continue;
    if (ends_with(model.frames[i].name, name)) return i;
    links.push_back(model.frames[i].name);
  }
  throw std::invalid_argument("the robot's URDF should have a link whose name ends with " + name + ", and has " +
                              list(links));
}

// Of link7 alone. What is fixed beyond the flange comes by set_tool().
pinocchio::Inertia last_link(const pinocchio::Model& model) {
  const auto flange = link(model, kJoints + 1);
  const auto joint = model.frames[flange].parentJoint;
  std::vector<bool> before(model.frames.size(), false);
  for (auto i = flange; i != 0; i = model.frames[i].parentFrame) before[i] = true;
  pinocchio::Inertia inertia = model.inertias[joint];
  for (pinocchio::FrameIndex i = 0; i < model.frames.size(); ++i) {
    const auto& frame = model.frames[i];
    if (frame.parentJoint == joint && !before[i]) inertia -= frame.placement.act(frame.inertia);
  }
  return inertia;
}

// Fixes every joint but joint1..joint7 (a hand's fingers have joints as well).
pinocchio::Model reduce(const pinocchio::Model& model) {
  std::vector<pinocchio::JointIndex> extra;
  std::vector<std::string> joints;
  for (pinocchio::JointIndex i = 1; i < static_cast<pinocchio::JointIndex>(model.njoints); ++i) {
    const std::string& name = model.names[i];
    const int next = static_cast<int>(joints.size()) + 1;
    const bool ours = next <= kJoints && model.joints[i].nq() == 1 && name.find("finger") == std::string::npos &&
                      ends_with(name, "joint" + std::to_string(next));
    if (ours) {
      joints.push_back(name);
    } else {
      extra.push_back(i);
    }
  }
  if (joints.size() != kJoints) {
    std::vector<std::string> names(model.names.begin() + 1, model.names.end());
    throw std::invalid_argument("the robot's URDF should have revolute joints joint1 to joint7 in a row; joint" +
                                std::to_string(joints.size() + 1) + " is missing among its movable joints " +
                                list(names));
  }
  return extra.empty() ? model : pinocchio::buildReducedModel(model, extra, pinocchio::neutral(model));
}

// By elimination with pivots, in plain loops as Cholesky.
double determinant(Matrix6 A) noexcept {
  double out = 1;
  for (int j = 0; j < 6; ++j) {
    int pivot = j;
    for (int i = j + 1; i < 6; ++i) {
      if (std::abs(A(i, j)) > std::abs(A(pivot, j))) pivot = i;
    }
    if (pivot != j) {
      A.row(pivot).swap(A.row(j));
      out = -out;
    }
    out *= A(j, j);
    if (A(j, j) == 0) break;
    const double over = 1 / A(j, j);
    for (int i = j + 1; i < 6; ++i) {
      const double share = A(i, j) * over;
      for (int k = j + 1; k < 6; ++k) A(i, k) -= share * A(j, k);
    }
  }
  return out;
}

}  // namespace

struct Model::Impl {
  pinocchio::Model model;
  pinocchio::Data data, kinematics;     // `kinematics` serves O_T_EE(q) alone
  Eigen::VectorXd q, q_kinematics;
  pinocchio::SE3 J7_T_F, J7_T_EE;
  pinocchio::Inertia link7;

  Eigen::Isometry3d O_T_EE;
  Matrix67 J;
  Vector6 dJ_dq;
  Matrix7 M;
  Vector7 c;

  explicit Impl(const pinocchio::Model& description)
      : model(reduce(description)),
        data(model),
        kinematics(model),
        q(Eigen::VectorXd::Zero(kJoints)),
        q_kinematics(Eigen::VectorXd::Zero(kJoints)),
        link7(last_link(description)) {
    const auto flange = link(model, kJoints + 1);
    if (model.frames[flange].parentJoint != kJoints) {
      throw std::invalid_argument("the robot's URDF should have its flange " + model.frames[flange].name +
                                  " fixed to joint7, and has it on " + model.names[model.frames[flange].parentJoint]);
    }
    J7_T_F = model.frames[flange].placement;
    J7_T_EE = J7_T_F;

    // O is link0, wherever the description's root is.
    const auto& base = model.frames[link(model, 0)];
    model.jointPlacements[1] = base.placement.actInv(model.jointPlacements[1]);

    model.inertias[kJoints] = link7;
    model.gravity.setZero();  // the robot compensates it
  }

  Eigen::Isometry3d end_effector(const pinocchio::SE3& O_T_J7) const {
    const pinocchio::SE3 pose = O_T_J7 * J7_T_EE;
    Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
    out.linear() = pose.rotation();
    out.translation() = pose.translation();
    return out;
  }
};

Model::Model(const std::string& urdf) : impl_(std::make_unique<Impl>(parse(urdf))) {
  update(Vector7::Zero(), Vector7::Zero());
}

Model::~Model() = default;

void Model::set_tool(double mass, const Vector3& F_x_C, const Eigen::Matrix3d& I,
                     const Eigen::Isometry3d& F_T_EE) noexcept {
  Impl& m = *impl_;
  m.J7_T_EE = m.J7_T_F * pinocchio::SE3(F_T_EE.linear(), F_T_EE.translation());
  m.model.inertias[kJoints] = m.link7;
  if (mass > 0) {
    m.model.inertias[kJoints] += m.J7_T_F.act(pinocchio::Inertia(mass, F_x_C, pinocchio::Symmetric3(I)));
  }
}

void Model::update(const Vector7& q, const Vector7& dq) noexcept {
  Impl& m = *impl_;
  m.q = q;

  // In world convention this fills data.oMi and data.J (velocity of the point at the origin) too.
  pinocchio::crba(m.model, m.data, In(m.q), pinocchio::Convention::WORLD);
  m.M = m.data.M;
  m.M.triangularView<Eigen::StrictlyLower>() = m.M.transpose();
  m.O_T_EE = m.end_effector(m.data.oMi[kJoints]);
  const Vector3 p = m.O_T_EE.translation();
  for (int i = 0; i < kJoints; ++i) {
    const Vector3 angular = m.data.J.col(i).tail<3>();
    m.J.col(i).head<3>() = m.data.J.col(i).head<3>() + angular.cross(p);
    m.J.col(i).tail<3>() = angular;
  }

  // Newton and Euler about the origin of O, with what crba() leaves: nonLinearEffects() would begin with the joints again.
  std::array<Vector6, kJoints> force;
  pinocchio::Motion v = pinocchio::Motion::Zero(), a = pinocchio::Motion::Zero();
  for (int i = 0; i < kJoints; ++i) {
    const pinocchio::Motion of_joint(m.data.J.col(i) * dq[i]);
    a += v.cross(of_joint);
    v += of_joint;
    const pinocchio::Inertia link = m.data.oMi[i + 1].act(m.model.inertias[i + 1]);
    force[i] = (link * a + v.cross(link * v)).toVector();
  }
  Vector6 sum = Vector6::Zero();
  for (int i = kJoints - 1; i >= 0; --i) {
    sum += force[i];
    m.c[i] = m.data.J.col(i).dot(sum);
  }

  // With ddq = 0 the acceleration of EE is dJ dq; as a spatial one it lacks the turn of the velocity.
  const Vector3 w = v.angular(), dw = a.angular();
  m.dJ_dq.head<3>() = a.linear() + dw.cross(p) + w.cross(v.linear() + w.cross(p));
  m.dJ_dq.tail<3>() = dw;
}

const Eigen::Isometry3d& Model::O_T_EE() const noexcept { return impl_->O_T_EE; }
const Matrix67& Model::jacobian() const noexcept { return impl_->J; }
const Vector6& Model::dJ_dq() const noexcept { return impl_->dJ_dq; }
const Matrix7& Model::mass() const noexcept { return impl_->M; }
const Vector7& Model::coriolis() const noexcept { return impl_->c; }

Vector7 Model::gravity(const Vector3& O_g) const noexcept {
  const Impl& m = *impl_;
  Vector7 out;
  for (int i = 0; i < kJoints; ++i) {
    // All that joint i carries, about the origin of O; `lever` is its centre of mass.
    const pinocchio::Inertia& carried = m.data.oYcrb[i + 1];
    const Vector3 force = carried.mass() * O_g, moment = carried.lever().cross(force);
    out[i] = -m.data.J.col(i).head<3>().dot(force) - m.data.J.col(i).tail<3>().dot(moment);
  }
  return out;
}

Eigen::Isometry3d Model::O_T_EE(const Vector7& q) noexcept {
  Impl& m = *impl_;
  m.q_kinematics = q;
  pinocchio::forwardKinematics(m.model, m.kinematics, In(m.q_kinematics));
  return m.end_effector(m.kinematics.oMi[kJoints]);
}

JointsOfPose Model::joints_of_pose(const Vector7& q, double damping) noexcept {
  constexpr int kElbow = 2;
  Impl& m = *impl_;
  m.q_kinematics = q;
  pinocchio::computeJointJacobians(m.model, m.kinematics, In(m.q_kinematics));
  const Eigen::Isometry3d O_T_EE = m.end_effector(m.kinematics.oMi[kJoints]);
  const Vector3 p = O_T_EE.translation();
  Matrix6 J;
  Vector6 elbow;
  for (int i = 0, column = 0; i < kJoints; ++i) {
    const Vector3 angular = m.kinematics.J.col(i).tail<3>();
    Vector6 twist;
    twist.head<3>() = m.kinematics.J.col(i).head<3>() + angular.cross(p);
    twist.tail<3>() = angular;
    if (i == kElbow) {
      elbow = twist;
    } else {
      J.col(column++) = twist;
    }
  }
  Matrix6 normal = J.transpose() * J;
  normal.diagonal().array() += damping;
  const Matrix6 inverse = Cholesky<6>(normal).solve<6>(J.transpose());
  JointsOfPose out;
  out.q = q;
  out.O_T_EE = O_T_EE;
  out.determinant = determinant(J);
  out.dq_dP.topRows<kElbow>() = inverse.topRows<kElbow>();
  out.dq_dP.bottomRows<kJoints - 1 - kElbow>() = inverse.bottomRows<kJoints - 1 - kElbow>();
  out.null_motion = Vector7::Unit(kElbow) - out.dq_dP * elbow;
  return out;
}

}  // namespace realtime
