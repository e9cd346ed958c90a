// One library per arm: FRANKA_MODEL_ARM is the arm's name. It runs in the client's process, so it
// needs nothing but the C library and exports nothing but franka_model.h.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>

#include "models/arm.hpp"
#include "sim/model_library/franka_model.h"

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix67 = Eigen::Matrix<double, 6, 7>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;

constexpr int kFlange = 8;
constexpr int kEndEffector = 9;

struct Frame {
  Matrix3d R;
  Vector3d p;

  Frame operator*(const Frame& next) const { return {R * next.R, p + R * next.p}; }
};

struct Body {
  double mass;
  Vector3d com;
  Matrix3d inertia;  // about com
};

struct Chain {
  std::array<Frame, 8> placements;  // of a frame in the one before it, at q = 0
  std::array<Body, 7> links;        // what joints 1 to 7 carry
};

Chain read_chain() {
  const models::Arm* arm = nullptr;
  for (const models::Arm& known : models::arms()) {
    if (known.name == FRANKA_MODEL_ARM) arm = &known;
  }
  Chain chain;
  for (int i = 0; i < 8; ++i) {
    const auto& [xyz, rpy] = arm->joints[i];
    using Eigen::AngleAxisd;
    chain.placements[i] = {(AngleAxisd(rpy[2], Vector3d::UnitZ()) * AngleAxisd(rpy[1], Vector3d::UnitY()) *
                            AngleAxisd(rpy[0], Vector3d::UnitX()))
                               .toRotationMatrix(),
                           Vector3d(xyz.data())};
  }
  for (int i = 0; i < 7; ++i) {
    const models::Link& link = arm->links[i + 1];
    const auto& [xx, yy, zz, xy, xz, yz] = link.inertia;
    chain.links[i] = {link.mass, Vector3d(link.com.data()),
                      (Matrix3d() << xx, xy, xz, xy, yy, yz, xz, yz, zz).finished()};
  }
  return chain;
}

const Chain kChain = read_chain();

// Frames J1 to J9 in O, by their numbers; [0] is O itself.
using Frames = std::array<Frame, 10>;

Frames place(const double* q, const double* F_T_EE = nullptr) {
  Frames frames;
  frames[0] = {Matrix3d::Identity(), Vector3d::Zero()};
  for (int i = 1; i <= 7; ++i) {
    const Frame turned = {Eigen::AngleAxisd(q[i - 1], Vector3d::UnitZ()).toRotationMatrix(), Vector3d::Zero()};
    frames[i] = frames[i - 1] * kChain.placements[i - 1] * turned;
  }
  frames[kFlange] = frames[7] * kChain.placements[7];
  if (F_T_EE) {
    const Eigen::Map<const Eigen::Matrix4d> T(F_T_EE);
    frames[kEndEffector] = frames[kFlange] * Frame{T.topLeftCorner<3, 3>(), T.topRightCorner<3, 1>()};
  }
  return frames;
}

void pose(int frame, const double* q, double* out, const double* F_T_EE = nullptr) {
  const Frame f = place(q, F_T_EE)[frame];
  Eigen::Map<Eigen::Matrix4d> T(out);
  T << f.R, f.p, 0, 0, 0, 1;
}

Matrix67 jacobian(const Frames& frames, int frame) {
  Matrix67 J = Matrix67::Zero();
  for (int i = 1; i <= 7 && i <= frame; ++i) {
    const Vector3d axis = frames[i].R.col(2);
    J.col(i - 1) << axis.cross(frames[frame].p - frames[i].p), axis;
  }
  return J;
}

void base_jacobian(int frame, const double* q, double* out, const double* F_T_EE = nullptr) {
  Eigen::Map<Matrix67>(out, 6, 7) = jacobian(place(q, F_T_EE), frame);
}

void body_jacobian(int frame, const double* q, double* out, const double* F_T_EE = nullptr) {
  const Frames frames = place(q, F_T_EE);
  const Matrix67 J = jacobian(frames, frame);
  const Matrix3d R = frames[frame].R.transpose();
  Eigen::Map<Matrix67>(out, 6, 7) << R * J.topRows<3>(), R * J.bottomRows<3>();
}

// Inverse dynamics by recursive Newton-Euler (Luh, Walker, Paul 1980), vectors in the axes of O:
// outwards the motion of each link, inwards the forces which that takes. Gravity enters as an
// acceleration of the base against it.
Vector7 newton_euler(const Frames& frames, const Vector7& dq, const Vector7& ddq, const Vector3d& gravity,
                     const Body& tool) {
  // Forces on the bodies, and their moments about O, summed up from each joint on.
  std::array<Vector3d, 7> force, moment;
  Vector3d omega = Vector3d::Zero(), alpha = Vector3d::Zero(), acceleration = -gravity;
  Vector3d origin = Vector3d::Zero();
  for (int i = 0; i < 7; ++i) {
    const Frame& joint = frames[i + 1];
    const Vector3d arm = joint.p - origin;
    acceleration += alpha.cross(arm) + omega.cross(omega.cross(arm));
    origin = joint.p;
    const Vector3d axis = joint.R.col(2);
    alpha += axis * ddq[i] + omega.cross(axis * dq[i]);
    omega += axis * dq[i];

    force[i] = moment[i] = Vector3d::Zero();
    const auto add = [&](const Body& body, const Frame& frame) {
      const Vector3d com = frame.p + frame.R * body.com;
      const Vector3d r = com - origin;
      const Matrix3d I = frame.R * body.inertia * frame.R.transpose();
      const Vector3d f = body.mass * (acceleration + alpha.cross(r) + omega.cross(omega.cross(r)));
      force[i] += f;
      moment[i] += com.cross(f) + I * alpha + omega.cross(I * omega);
    };
    add(kChain.links[i], joint);
    if (i == 6) add(tool, frames[kFlange]);
  }
  Vector7 tau;
  Vector3d f = Vector3d::Zero(), n = Vector3d::Zero();
  for (int i = 6; i >= 0; --i) {
    f += force[i];
    n += moment[i];
    tau[i] = frames[i + 1].R.col(2).dot(n - frames[i + 1].p.cross(f));
  }
  return tau;
}

Body tool_of(const double* I_total, double m_total, const double* F_x_Ctotal) {
  return {m_total, Vector3d(F_x_Ctotal), Matrix3d(I_total)};
}

}  // namespace

void O_T_J1(const double* q, double* out) { pose(1, q, out); }
void O_T_J2(const double* q, double* out) { pose(2, q, out); }
void O_T_J3(const double* q, double* out) { pose(3, q, out); }
void O_T_J4(const double* q, double* out) { pose(4, q, out); }
void O_T_J5(const double* q, double* out) { pose(5, q, out); }
void O_T_J6(const double* q, double* out) { pose(6, q, out); }
void O_T_J7(const double* q, double* out) { pose(7, q, out); }
void O_T_J8(const double* q, double* out) { pose(kFlange, q, out); }
void O_T_J9(const double* q, const double* F_T_EE, double* out) { pose(kEndEffector, q, out, F_T_EE); }

void O_J_J1(double* out) { base_jacobian(1, Vector7::Zero().eval().data(), out); }
void O_J_J2(const double* q, double* out) { base_jacobian(2, q, out); }
void O_J_J3(const double* q, double* out) { base_jacobian(3, q, out); }
void O_J_J4(const double* q, double* out) { base_jacobian(4, q, out); }
void O_J_J5(const double* q, double* out) { base_jacobian(5, q, out); }
void O_J_J6(const double* q, double* out) { base_jacobian(6, q, out); }
void O_J_J7(const double* q, double* out) { base_jacobian(7, q, out); }
void O_J_J8(const double* q, double* out) { base_jacobian(kFlange, q, out); }
void O_J_J9(const double* q, const double* F_T_EE, double* out) { base_jacobian(kEndEffector, q, out, F_T_EE); }

void Ji_J_J1(double* out) { body_jacobian(1, Vector7::Zero().eval().data(), out); }
void Ji_J_J2(const double* q, double* out) { body_jacobian(2, q, out); }
void Ji_J_J3(const double* q, double* out) { body_jacobian(3, q, out); }
void Ji_J_J4(const double* q, double* out) { body_jacobian(4, q, out); }
void Ji_J_J5(const double* q, double* out) { body_jacobian(5, q, out); }
void Ji_J_J6(const double* q, double* out) { body_jacobian(6, q, out); }
void Ji_J_J7(const double* q, double* out) { body_jacobian(7, q, out); }
void Ji_J_J8(const double* q, double* out) { body_jacobian(kFlange, q, out); }
void Ji_J_J9(const double* q, const double* F_T_EE, double* out) { body_jacobian(kEndEffector, q, out, F_T_EE); }

void M_NE(const double* q, const double* I_total, double m_total, const double* F_x_Ctotal, double* out) {
  const Frames frames = place(q);
  const Body tool = tool_of(I_total, m_total, F_x_Ctotal);
  Eigen::Map<Matrix7> M(out);
  for (int i = 0; i < 7; ++i) {
    M.col(i) = newton_euler(frames, Vector7::Zero(), Vector7::Unit(i), Vector3d::Zero(), tool);
  }
}

void c_NE(const double* q, const double* dq, const double* I_total, double m_total, const double* F_x_Ctotal,
          double* out) {
  Eigen::Map<Vector7>(out, 7) =
      newton_euler(place(q), Vector7(dq), Vector7::Zero(), Vector3d::Zero(), tool_of(I_total, m_total, F_x_Ctotal));
}

void g_NE(const double* q, const double* g_earth, double m_total, const double* F_x_Ctotal, double* out) {
  const Body tool = {m_total, Vector3d(F_x_Ctotal), Matrix3d::Zero()};  // at rest inertia does not matter
  Eigen::Map<Vector7>(out, 7) = newton_euler(place(q), Vector7::Zero(), Vector7::Zero(), Vector3d(g_earth), tool);
}
