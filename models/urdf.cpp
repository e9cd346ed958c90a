#include <cstdio>

#include "models/arm.hpp"

namespace models {
namespace {

// Shortest text that reads back as the same double.
std::string number(double value) {
  char text[32];
  for (int digits = 15; digits <= 17; ++digits) {
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    if (std::stod(text) == value) break;
  }
  return text;
}

std::string triple(const Vector3& v) {
  return number(v[0]) + " " + number(v[1]) + " " + number(v[2]);
}

std::string attribute(const char* name, double value) {
  return std::string(" ") + name + "=\"" + number(value) + "\"";
}

std::string link(int index, const Link& link) {
  const auto& I = link.inertia;
  return "  <link name=\"link" + std::to_string(index) + "\">\n    <inertial>\n      <origin xyz=\"" +
         triple(link.com) + "\" rpy=\"0 0 0\"/>\n      <mass" + attribute("value", link.mass) +
         "/>\n      <inertia" + attribute("ixx", I[0]) + attribute("iyy", I[1]) +
         attribute("izz", I[2]) + attribute("ixy", I[3]) + attribute("ixz", I[4]) +
         attribute("iyz", I[5]) + "/>\n    </inertial>\n  </link>\n";
}

std::string joint_head(int number, const char* type, const JointFrame& frame) {
  return "  <joint name=\"joint" + std::to_string(number) + "\" type=\"" + type +
         "\">\n    <parent link=\"link" + std::to_string(number - 1) + "\"/>\n    <child link=\"link" +
         std::to_string(number) + "\"/>\n    <origin xyz=\"" + triple(frame.xyz) + "\" rpy=\"" +
         triple(frame.rpy) + "\"/>\n";
}

}  // namespace

std::string urdf(const Arm& arm, std::uint16_t version) {
  // Where speed does not depend on position: a client takes sqrt(2 deceleration distance) - offset for the most, and 0 would be that.
  constexpr double kAnyDeceleration = 1e9;  // rad/s²
  const Limits& limits = models::limits(arm, version);
  std::string text = "<?xml version=\"1.0\"?>\n<robot name=\"" + std::string(arm.name) + "\">\n";
  text += link(0, arm.links[0]);
  for (int i = 0; i < kJoints; ++i) {
    const double deceleration = limits.envelope_deceleration[i];
    text += joint_head(i + 1, "revolute", arm.joints[i]);
    text += "    <axis xyz=\"0 0 1\"/>\n    <limit" + attribute("lower", limits.q_min[i]) +
            attribute("upper", limits.q_max[i]) + attribute("velocity", limits.dq_max[i]) +
            attribute("effort", limits.tau_max[i]) + "/>\n    <position_based_velocity_limits" +
            attribute("velocity_offset", limits.envelope_offset[i]) +
            attribute("deceleration_limit", deceleration != 0 ? deceleration : kAnyDeceleration) + "/>\n  </joint>\n";
    text += link(i + 1, arm.links[i + 1]);
  }
  text += joint_head(8, "fixed", arm.joints[7]) + "  </joint>\n  <link name=\"link8\"/>\n</robot>\n";
  return text;
}

}  // namespace models
