#pragma once

#include <string>

#include "models/arm.hpp"
#include "realtime/model.hpp"
#include "server/config.hpp"
#include "wire/fci/robot_state.hpp"

namespace server {

// Which arm answers, and the URDF that describes it.
struct ArmModel {
  const models::Arm* arm = nullptr;
  std::string urdf;
  std::string warning;  // empty when nothing is doubtful
};

// Of a robot that speaks protocol `version`: up to 5 a FER, 6 and 7 an FR3; from 8 on its own URDF says
// (`robot_urdf`; empty when it gave none). `configured` ("auto" or a name) says it where the robot does not, and is told of
// doubts; one that the robot contradicts is refused (std::invalid_argument), as another arm's limits and masses would apply.
ArmModel choose_model(fci::Version version, const std::string& robot_urdf, const std::string& configured);

// With velocities, accelerations and jerks times these factors.
models::Limits scaled(models::Limits limits, double velocity, double acceleration, double jerk);

// rad before the ends of its joints' ranges that an arm is kept: where the robot holds a reference itself, friction leaves its joints
// a little beyond.
constexpr double kBeforeEnd = 0.005;

// Limits of that arm, kBeforeEnd inside its ranges and scaled as configured. Throws std::invalid_argument where its URDF's contradict them.
models::Limits scaled_limits(const ArmModel& model, fci::Version version, const ArmConfig& config);

}  // namespace server
