#pragma once

#include <cmath>

#include "realtime/reference.hpp"

namespace realtime {

// The rotation by |r| about r, and back: |r| in rad, 0 to pi, the shortest way (either sign of the
// quaternion is the same rotation).

inline Eigen::Quaterniond exp(const Vector3& r) {
  const double angle = r.norm();
  // sin(x/2)/x, by its series where the quotient would lose digits.
  const double scale = angle > 1e-4 ? std::sin(angle / 2) / angle : 0.5 - angle * angle / 48;
  Eigen::Quaterniond q;
  q.w() = std::cos(angle / 2);
  q.vec() = scale * r;
  return q;
}

inline Vector3 log(const Eigen::Quaterniond& q) {
  const double sine = q.vec().norm();
  const double sign = q.w() < 0 ? -1 : 1;
  const double cosine = std::abs(q.w());
  // 2 atan(x)/sin, by its series where the quotient would lose digits.
  const double scale =
      sine > 1e-4 ? 2 * std::atan2(sine, cosine) / sine : (2 - 2.0 / 3 * sine * sine / (cosine * cosine)) / cosine;
  return sign * scale * q.vec();
}

// Angular velocity and acceleration of R(t) = exp(r(t)) R0, in the axes that r is given in, from r and
// its derivatives:
//   w = dr + A r×dr + B r×(r×dr),  A = (1 - cos x)/x², B = (x - sin x)/x³, x = |r|
// (left Jacobian of SO(3): Solà, Deray, Atchuthan, A micro Lie theory for state estimation in robotics,
// 2018, eq. 145), and that differentiated.
struct RotationRates {
  Vector3 velocity, acceleration;
};

inline RotationRates rotation_rates(const Vector3& r, const Vector3& dr, const Vector3& ddr) {
  const double x2 = r.squaredNorm();
  const double x = std::sqrt(x2);
  double A = 0.5 - x2 / 24, B = 1.0 / 6 - x2 / 120;
  double dA = -1.0 / 12 + x2 / 180, dB = -1.0 / 60 + x2 / 1260;  // each divided by x
  if (x > 0.02) {
    const double s = std::sin(x), c = std::cos(x);
    A = (1 - c) / x2;
    B = (x - s) / (x2 * x);
    dA = (x * s - 2 * (1 - c)) / (x2 * x2);
    dB = (x * (1 - c) - 3 * (x - s)) / (x2 * x2 * x);
  }
  const double change = r.dot(dr);
  const Vector3 r_dr = r.cross(dr);
  const Vector3 r_r_dr = r.cross(r_dr);
  const Vector3 r_ddr = r.cross(ddr);
  return {dr + A * r_dr + B * r_r_dr,
          ddr + A * r_ddr + B * (r.cross(r_ddr) + dr.cross(r_dr)) + change * (dA * r_dr + dB * r_r_dr)};
}

// The other way: derivatives of r from angular velocity and acceleration, for |r| well below 2 pi.
struct RotationVectorRates {
  Vector3 dr, ddr;
};

inline RotationVectorRates rotation_vector_rates(const Vector3& r, const Vector3& velocity,
                                                 const Vector3& acceleration) {
  const double x = r.norm();
  const double C = x > 0.02 ? (1 - x / 2 / std::tan(x / 2)) / (x * x) : 1.0 / 12 + x * x / 720;
  const auto invert = [&](const Vector3& w) { return Vector3(w - 0.5 * r.cross(w) + C * r.cross(r.cross(w))); };
  const Vector3 dr = invert(velocity);
  return {dr, invert(acceleration - rotation_rates(r, dr, Vector3::Zero()).acceleration)};
}

// What leads from one pose to the other: m, and a rotation vector; axes of O.
inline Vector6 change_between(const CartesianReference& from, const CartesianReference& to) {
  Vector6 change;
  change.head<3>() = to.position - from.position;
  change.tail<3>() = log(to.orientation * from.orientation.conjugate());
  return change;
}

// A frame as a reference at rest.
inline CartesianReference at(const Eigen::Isometry3d& O_T_EE) {
  CartesianReference out;
  out.position = O_T_EE.translation();
  out.orientation = Eigen::Quaterniond(O_T_EE.linear());
  return out;
}

// And back.
inline Eigen::Isometry3d frame(const CartesianReference& pose) {
  Eigen::Isometry3d O_T_EE(pose.orientation);
  O_T_EE.translation() = pose.position;
  return O_T_EE;
}

}  // namespace realtime
