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
// (`robot_urdf`; empty when it gave none). `configured` ("auto" or a name) goes before all that, with a
// warning when the robot says otherwise.
ArmModel choose_model(fci::Version version, const std::string& robot_urdf, const std::string& configured);

// Limits of that arm, scaled as configured.
models::Limits scaled_limits(const models::Arm& arm, fci::Version version, const ArmConfig& config);

}  // namespace server
