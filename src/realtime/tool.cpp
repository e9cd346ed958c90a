#include "realtime/tool.hpp"

namespace realtime {

Eigen::Isometry3d pose(const fci::Pose& values) noexcept {
  Eigen::Isometry3d T;
  T.matrix() = Eigen::Matrix4d::Map(values.data());
  return T;
}

bool is_pose(const fci::Pose& values) noexcept {
  const Eigen::Matrix4d T = Eigen::Matrix4d::Map(values.data());
  const Eigen::Matrix3d R = T.topLeftCorner<3, 3>();
  return T.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1), 1e-3) && (R.transpose() * R).isIdentity(1e-3) &&
         R.determinant() > 0;
}

void carry(const fci::RobotState& s, Model& model) noexcept {
  const double mass = s.m_ee + s.m_load;
  const Vector3 c_ee = Vector3::Map(s.F_x_Cee.data());
  const Vector3 c_load = Vector3::Map(s.F_x_Cload.data());
  const Vector3 c = mass > 0 ? Vector3((s.m_ee * c_ee + s.m_load * c_load) / mass) : Vector3(Vector3::Zero());
  const auto about = [](double m, const Vector3& d) -> Eigen::Matrix3d {  // parallel axes
    return m * (d.squaredNorm() * Eigen::Matrix3d::Identity() - d * d.transpose());
  };
  const Eigen::Matrix3d I = Eigen::Matrix3d::Map(s.I_ee.data()) + about(s.m_ee, c_ee - c) +
                            Eigen::Matrix3d::Map(s.I_load.data()) + about(s.m_load, c_load - c);
  model.set_tool(mass, c, I, is_pose(s.F_T_EE) ? pose(s.F_T_EE) : Eigen::Isometry3d::Identity());
}

}  // namespace realtime
