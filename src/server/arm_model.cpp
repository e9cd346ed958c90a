#include "server/arm_model.hpp"

#include <spdlog/fmt/fmt.h>

#include <memory>
#include <regex>
#include <stdexcept>

#include "server/urdf_limits.hpp"

namespace server {
namespace {

constexpr fci::Version kFirstFr3 = 6;
constexpr fci::Version kFirstWithUrdf = 8;
constexpr std::size_t kUrdfHead = 4096;  // bytes in which the name of the robot is looked for

realtime::Matrix7 mass_at_home(const std::string& urdf) {
  realtime::Model model(urdf);
  model.update(Eigen::Map<const realtime::Vector7>(models::kHome.data()), realtime::Vector7::Zero());
  return model.mass();
}

// By the name of the robot in its URDF; null where that is none of ours.
const models::Arm* by_name(const std::string& urdf) {
  const std::string head = urdf.substr(0, kUrdfHead);
  std::smatch match;
  if (!std::regex_search(head, match, std::regex("<robot[^>]*\\sname\\s*=\\s*[\"']([^\"']*)[\"']"))) return nullptr;
  const std::string name = match[1] == "panda" ? "fer" : match[1].str();
  for (const auto& arm : models::arms()) {
    if (arm.name == name) return &arm;
  }
  return nullptr;
}

// By the inertia that is nearest.
const models::Arm& by_mass(const realtime::Matrix7& mass, fci::Version version) {
  const models::Arm* nearest = nullptr;
  double least = std::numeric_limits<double>::infinity();
  for (const auto& arm : models::arms()) {
    const double distance = (mass_at_home(models::urdf(arm, version)) - mass).norm();
    if (distance < least) {
      least = distance;
      nearest = &arm;
    }
  }
  return *nearest;
}

ArmModel ask_robot(fci::Version version, const std::string& robot_urdf) {
  ArmModel model;
  if (version < kFirstWithUrdf) {
    model.arm = &models::arm(version < kFirstFr3 ? "fer" : "fr3");
  } else {
    try {
      if (robot_urdf.empty()) throw std::invalid_argument("it gave none");
      const realtime::Matrix7 mass = mass_at_home(robot_urdf);
      if (!(mass.diagonal().minCoeff() > 1e-6)) throw std::invalid_argument("its links have no inertia");
      const models::Arm* named = by_name(robot_urdf);
      model.arm = named != nullptr ? named : &by_mass(mass, version);
      model.urdf = robot_urdf;
      return model;
    } catch (const std::exception& error) {
      model.arm = &models::arm("fr3");
      model.warning = fmt::format("the robot's own description (URDF) is not usable ({}); that of {} is used. Remedy: set "
                                  "`model` in the configuration if it is another arm",
                                  error.what(), model.arm->name);
    }
  }
  model.urdf = models::urdf(*model.arm, version);
  return model;
}

}  // namespace

ArmModel choose_model(fci::Version version, const std::string& robot_urdf, const std::string& configured) {
  ArmModel model = ask_robot(version, robot_urdf);
  if (configured == "auto" || configured == model.arm->name) return model;
  const models::Arm* named = version >= kFirstWithUrdf ? by_name(robot_urdf) : nullptr;
  if (named != nullptr || (configured == "fer") != (version < kFirstFr3)) {
    throw std::invalid_argument(fmt::format("the configuration says model = \"{}\", and the robot (protocol version {}) is {}: limits "
                                            "and masses of another arm would apply. Set model = \"auto\", or the address of the arm "
                                            "that is meant",
                                            configured, version, named != nullptr ? named->title : model.arm->title));
  }
  ArmModel other;
  other.arm = &models::arm(configured);
  other.urdf = models::urdf(*other.arm, version);
  // Versions 6 and 7 do not say which FR3 it is.
  if (version >= kFirstWithUrdf) {
    other.warning = fmt::format("the configuration says model = \"{}\", the robot (protocol version {}) looks like {}. "
                                "Remedy: set model = \"auto\" unless the robot is wrong",
                                configured, version, model.arm->name);
  }
  return other;
}

models::Limits scaled(models::Limits limits, double velocity, double acceleration, double jerk) {
  for (int i = 0; i < models::kJoints; ++i) {
    limits.dq_max[i] *= velocity;
    limits.ddq_max[i] *= acceleration;
    limits.dddq_max[i] *= jerk;
  }
  for (auto* rates : {&limits.translation, &limits.rotation, &limits.elbow}) {
    rates->velocity *= velocity;
    rates->acceleration *= acceleration;
    rates->jerk *= jerk;
  }
  return limits;
}

models::Limits scaled_limits(const ArmModel& model, fci::Version version, const ArmConfig& config) {
  models::Limits limits = narrowed(models::limits(*model.arm, version), model.urdf);
  for (int i = 0; i < models::kJoints; ++i) {
    limits.q_min[i] += kBeforeEnd;
    limits.q_max[i] -= kBeforeEnd;
    if (limits.q_min[i] < limits.q_max[i]) continue;
    throw std::invalid_argument(fmt::format("the robot's URDF leaves joint {} no more than {:.4f} rad: expected a range of more than {} rad",
                                            i + 1, limits.q_max[i] - limits.q_min[i] + 2 * kBeforeEnd, 2 * kBeforeEnd));
  }
  return scaled(limits, config.limits.velocity, config.limits.acceleration, config.limits.jerk);
}

}  // namespace server
