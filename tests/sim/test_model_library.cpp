// The library which clients of protocol 3 to 9 load, against Pinocchio on the URDF which the arm gives
// to clients of protocol 8 and later.

#include "sim/model_library/model_library.hpp"

#include <dlfcn.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <Eigen/Dense>
#include <algorithm>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>
#include <random>
#include <string>

#include "models/arm.hpp"
#include "sim/model_library/franka_model.h"

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector3d;
using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix67 = Eigen::Matrix<double, 6, 7>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;
using In = Eigen::Ref<const Eigen::VectorXd>;  // what Pinocchio's library is compiled for, to compile less here

constexpr double kTolerance = 1e-10;  // m, rad, N m, kg m²: the same laws in the same precision
constexpr int kPostures = 100;
const Vector3d kGravity(0, 0, -9.81);

#if defined(__x86_64__)
constexpr fci::LoadModelLibrary kHere = {.architecture = 0, .system = 0};
#else
constexpr fci::LoadModelLibrary kHere = {.architecture = 3, .system = 0};
#endif

// The library as a client has it: a file of the bytes that came over the wire.
class Library {
 public:
  explicit Library(std::string_view arm) {
    const auto bytes = sim::model_library(arm, kHere);
    const int file = memfd_create("model_library", 0);
    EXPECT_EQ(write(file, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
    handle_ = dlopen(("/proc/self/fd/" + std::to_string(file)).c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!handle_) ADD_FAILURE() << dlerror();
    close(file);
  }
  ~Library() {
    if (handle_) dlclose(handle_);
  }
  Library(const Library&) = delete;

  void* symbol(const std::string& name) const { return handle_ ? dlsym(handle_, name.c_str()) : nullptr; }

  template <class Function>
  Function* get(const std::string& name) const {
    void* address = symbol(name);
    if (!address) throw std::runtime_error("the library lacks " + name);
    return reinterpret_cast<Function*>(address);
  }

  // Frames 1 (first joint) to 9 (end effector), whose functions differ in their arguments.
  Matrix4d pose(int n, const Vector7& q, const Matrix4d& F_T_EE) const {
    Matrix4d T;
    const std::string name = "O_T_J" + std::to_string(n);
    n == 9 ? get<decltype(O_T_J9)>(name)(q.data(), F_T_EE.data(), T.data())
           : get<decltype(O_T_J8)>(name)(q.data(), T.data());
    return T;
  }
  Matrix67 jacobian(const std::string& kind, int n, const Vector7& q, const Matrix4d& F_T_EE) const {
    Matrix67 J;
    const std::string name = kind + std::to_string(n);
    if (n == 1) {
      get<decltype(O_J_J1)>(name)(J.data());
    } else if (n == 9) {
      get<decltype(O_J_J9)>(name)(q.data(), F_T_EE.data(), J.data());
    } else {
      get<decltype(O_J_J8)>(name)(q.data(), J.data());
    }
    return J;
  }

 private:
  void* handle_;
};

struct Tool {
  double mass;
  Vector3d com;
  Matrix3d inertia;  // about com
};

class Random {
 public:
  double number(double low, double high) { return std::uniform_real_distribution(low, high)(engine_); }
  Vector3d vector(double size) { return {number(-size, size), number(-size, size), number(-size, size)}; }
  Vector7 vector7(double size) {
    return Vector7::NullaryExpr([&](Eigen::Index) { return number(-size, size); });
  }
  Vector7 posture(const models::Arm& arm) {
    const models::Limits& limits = models::limits(arm, 10);
    return Vector7::NullaryExpr([&](Eigen::Index i) { return number(limits.q_min[i], limits.q_max[i]); });
  }
  Matrix3d rotation() { return Eigen::AngleAxisd(number(-3, 3), vector(1).normalized()).toRotationMatrix(); }
  Matrix4d transform() {
    Matrix4d T = Matrix4d::Identity();
    T.topLeftCorner<3, 3>() = rotation();
    T.topRightCorner<3, 1>() = vector(0.3);
    return T;
  }
  // Principal moments that a body can have: none above the sum of the others.
  Tool tool() {
    const double a = number(0.001, 0.01), b = number(0.001, 0.01), c = number(0.001, 0.01);
    const Matrix3d R = rotation();
    return {number(0, 3), vector(0.1), R * Vector3d(a + b, b + c, c + a).asDiagonal() * R.transpose()};
  }

 private:
  std::mt19937 engine_{1};
};

class ModelLibrary : public testing::TestWithParam<std::string> {
 protected:
  const models::Arm& arm = models::arm(GetParam());
  Library library{GetParam()};
  Random random;
  pinocchio::Model model = [this] {
    pinocchio::Model model;
    pinocchio::urdf::buildModelFromXML(models::urdf(arm, 8), model);
    model.gravity.linear() = kGravity;
    return model;
  }();
  pinocchio::Data data{model};
  pinocchio::SE3 flange = model.frames[model.getFrameId("link8")].placement;

  // The model with the tool on its flange.
  pinocchio::Model with(const Tool& tool) const {
    pinocchio::Model with = model;
    with.appendBodyToJoint(7, pinocchio::Inertia(tool.mass, tool.com, tool.inertia), flange);
    return with;
  }
};

TEST_P(ModelLibrary, has_the_30_functions_that_clients_look_up) {
  std::vector<std::string> names = {"M_NE", "c_NE", "g_NE"};
  for (const char* kind : {"O_T_J", "O_J_J", "Ji_J_J"}) {
    for (int n = 1; n <= 9; ++n) names.push_back(kind + std::to_string(n));
  }
  ASSERT_EQ(names.size(), 30u);
  for (const std::string& name : names) EXPECT_TRUE(library.symbol(name)) << name;
}

TEST_P(ModelLibrary, keeps_all_other_symbols_to_itself) {
  EXPECT_FALSE(library.symbol("_ZN6models4armsEv"));  // models::arms()
}

TEST_P(ModelLibrary, has_pinocchios_kinematics) {
  for (int k = 0; k < kPostures; ++k) {
    const Vector7 q = random.posture(arm);
    const Matrix4d F_T_EE = random.transform();
    pinocchio::computeJointJacobians(model, data, In(q));
    for (int n = 1; n <= 9; ++n) {
      const int joint = std::min(n, 7);
      pinocchio::SE3 placement = n < 8 ? pinocchio::SE3::Identity() : flange;
      if (n == 9) placement = placement * pinocchio::SE3(F_T_EE);
      const pinocchio::SE3 pose = data.oMi[joint] * placement;
      EXPECT_LT((library.pose(n, q, F_T_EE) - pose.toHomogeneousMatrix()).norm(), kTolerance) << n;
      for (const auto& [kind, axes] :
           {std::pair{"Ji_J_J", pinocchio::LOCAL}, {"O_J_J", pinocchio::LOCAL_WORLD_ALIGNED}}) {
        const auto J = pinocchio::getFrameJacobian(model, data, joint, placement, axes);
        EXPECT_LT((library.jacobian(kind, n, q, F_T_EE) - J).norm(), kTolerance) << n;
      }
    }
  }
}

TEST_P(ModelLibrary, has_jacobians_that_are_the_derivatives_of_its_poses) {
  constexpr double h = 1e-6;
  const Vector7 q = random.posture(arm);
  const Matrix4d F_T_EE = random.transform();
  for (int n = 1; n <= 9; ++n) {
    const Matrix3d R = library.pose(n, q, F_T_EE).topLeftCorner<3, 3>();
    Matrix67 J;
    for (int i = 0; i < 7; ++i) {
      const Matrix4d dT =
          (library.pose(n, q + h * Vector7::Unit(i), F_T_EE) - library.pose(n, q - h * Vector7::Unit(i), F_T_EE)) /
          (2 * h);
      const Matrix3d spin = dT.topLeftCorner<3, 3>() * R.transpose();
      J.col(i) << dT.topRightCorner<3, 1>(), spin(2, 1), spin(0, 2), spin(1, 0);
    }
    EXPECT_LT((library.jacobian("O_J_J", n, q, F_T_EE) - J).norm(), 1e-8) << n;
  }
}

TEST_P(ModelLibrary, has_pinocchios_dynamics_with_what_is_on_the_flange) {
  const auto M_NE_ = library.get<decltype(M_NE)>("M_NE");
  const auto c_NE_ = library.get<decltype(c_NE)>("c_NE");
  const auto g_NE_ = library.get<decltype(g_NE)>("g_NE");
  for (int k = 0; k < kPostures; ++k) {
    const Vector7 q = random.posture(arm), dq = random.vector7(2.5);
    const Tool tool = k == 0 ? Tool{0, Vector3d::Zero(), Matrix3d::Zero()} : random.tool();
    const pinocchio::Model with_tool = with(tool);
    pinocchio::Data tool_data(with_tool);

    Matrix7 M;
    M_NE_(q.data(), tool.inertia.data(), tool.mass, tool.com.data(), M.data());
    pinocchio::crba(with_tool, tool_data, In(q), pinocchio::Convention::WORLD);
    const Matrix7 upper = tool_data.M.triangularView<Eigen::Upper>();
    EXPECT_LT((M - Matrix7(upper.selfadjointView<Eigen::Upper>())).norm(), kTolerance);

    Vector7 g;
    g_NE_(q.data(), kGravity.data(), tool.mass, tool.com.data(), g.data());
    EXPECT_LT((g - pinocchio::computeGeneralizedGravity(with_tool, tool_data, In(q))).norm(), kTolerance);

    Vector7 c;
    c_NE_(q.data(), dq.data(), tool.inertia.data(), tool.mass, tool.com.data(), c.data());
    EXPECT_LT((c + g - pinocchio::nonLinearEffects(with_tool, tool_data, In(q), In(dq))).norm(), kTolerance);

    const Vector7 ddq = random.vector7(10);
    EXPECT_LT((M * ddq + c + g - pinocchio::rnea(with_tool, tool_data, In(q), In(dq), In(ddq))).norm(), kTolerance);
  }
}

TEST_P(ModelLibrary, holds_against_gravity_from_any_side) {
  const auto g_NE_ = library.get<decltype(g_NE)>("g_NE");
  for (int k = 0; k < kPostures; ++k) {
    const Vector7 q = random.posture(arm);
    const Vector3d gravity = random.vector(10);
    const Tool tool = random.tool();
    pinocchio::Model with_tool = with(tool);
    with_tool.gravity.linear() = gravity;
    pinocchio::Data tool_data(with_tool);
    Vector7 g;
    g_NE_(q.data(), gravity.data(), tool.mass, tool.com.data(), g.data());
    EXPECT_LT((g - pinocchio::computeGeneralizedGravity(with_tool, tool_data, In(q))).norm(), kTolerance);
  }
}

TEST_P(ModelLibrary, is_there_for_this_machine_only) {
  EXPECT_FALSE(sim::model_library(GetParam(), kHere).empty());
  for (std::uint8_t architecture = 0; architecture < 6; ++architecture) {
    for (std::uint8_t system = 0; system < 3; ++system) {
      const bool here = architecture == kHere.architecture && system == kHere.system;
      EXPECT_EQ(!sim::model_library(GetParam(), {architecture, system}).empty(), here);
    }
  }
}

// The same check as that of the figures (tests/models), of what clients compute.
TEST(ModelLibraryOfFer, holds_a_real_arm_with_its_hand_at_home) {
  const Library library("fer");
  const Vector7 q(models::kHome.data());
  const Vector3d F_x_Chand(-0.01, 0, 0.03);
  Vector7 g;
  library.get<decltype(g_NE)>("g_NE")(q.data(), kGravity.data(), 0.73, F_x_Chand.data(), g.data());
  EXPECT_NEAR(g[1], -3.92, 0.01);
  EXPECT_NEAR(g[3], 21.90, 0.01);
  EXPECT_NEAR(g[5], 2.27, 0.01);
}

std::vector<std::string> arms() {
  std::vector<std::string> names;
  for (const models::Arm& arm : models::arms()) names.emplace_back(arm.name);
  return names;
}
INSTANTIATE_TEST_SUITE_P(Arms, ModelLibrary, testing::ValuesIn(arms()), [](const auto& info) { return info.param; });

}  // namespace
