#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "robot/mode.hpp"

namespace server {

// What an arm's process is told. As in TOML:
//
//   [server]
//   listen = "127.0.0.1"       # address of this computer; "0.0.0.0" for all
//   port = 5757                # 0: a free one
//
//   [[arm]]                    # one for each arm: robot_num 1, 2, ...
//   name = "left"
//   address = "172.16.0.2"     # of the robot
//   model = "auto"             # or fer, fr3, fr3v2; the robot is asked otherwise
//   gripper = true             # look for a Franka hand
//   hold_time = 2.0            # s that a motion is kept with nothing to do
//   [arm.load]                 # in the flange frame F
//   mass = 0.5                 # kg
//   center_of_mass = [0, 0, 0.05]                      # m
//   inertia = [1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3]     # kg m², about the centre of mass
//   [arm.tool]                 # end effector EE in the nominal end effector NE
//   translation = [0, 0, 0.05]                         # m
//   quaternion = [1, 0, 0, 0]                          # w, x, y, z
//   [arm.limits]               # factors of the arm's own limits, above 0 to 1
//   velocity = 0.5
//   acceleration = 1.0
//   jerk = 1.0
//   [arm.collision]            # contact from the lower, reflex from the upper thresholds; N m and N
//   lower_torque_thresholds = [20, 20, 18, 18, 16, 14, 12]
//   upper_torque_thresholds = [120, 120, 118, 118, 116, 114, 112]
//   lower_force_thresholds = [10, 10, 10, 10, 10, 10]
//   upper_force_thresholds = [120, 120, 120, 125, 125, 125]
struct ArmConfig {
  std::string name;
  std::string address;
  std::string model = "auto";
  bool gripper = true;
  double hold_time = 2;  // s
  struct {
    double velocity = 1, acceleration = 1, jerk = 1;
  } limits;
  robot::Settings settings;  // load, tool, collision behaviour where given
};

struct Config {
  std::string listen = "127.0.0.1";
  std::uint16_t port = 5757;
  std::vector<ArmConfig> arms;
};

// Says file, line, key, what was found and what was expected.
class ConfigError : public std::runtime_error {
 public:
  using runtime_error::runtime_error;
};

// Reads TOML text; `source` names it in errors. Throws ConfigError.
Config parse_config(const std::string& text, const std::string& source);

// The whole file as text. Throws ConfigError.
std::string read_config_file(const std::string& path);

// TOML of a server with one arm and defaults otherwise.
std::string config_of_robot(const std::string& address, bool gripper);

}  // namespace server
