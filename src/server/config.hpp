#pragma once

#include <cstdint>
#include <iosfwd>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "frankapy/proto/skill.pb.h"
#include "frankapy/proto/walls.pb.h"
#include "robot/mode.hpp"

namespace server {

// What a server may listen on.
bool is_address(const std::string& listen);
constexpr const char* kListenExpected = "an IPv4 address of this computer, such as \"127.0.0.1\" or \"0.0.0.0\"";

// The most that clients may ask for.
struct LimitsConfig {
  double velocity = 1, acceleration = 1, jerk = 1, torque = 1;  // of the robot's own
  std::optional<double> tool_speed = {}, power = {};            // m/s, W
};

// Who may bring the arm back at most, whatever clients ask for.
struct RecoveryConfig {
  using Who = frankapy::proto::RecoveryPolicy::Who;

  Who errors = frankapy::proto::RecoveryPolicy::ITSELF;     // of the robot
  Who collisions = frankapy::proto::RecoveryPolicy::ASK;    // reflexes of contact
  Who user_stop = frankapy::proto::RecoveryPolicy::ASK;     // once it is released
  unsigned times = 1000;  // in a row, by itself
};

// What an arm's process is told; examples/arms.toml has every key with its unit.
struct ArmConfig {
  std::string name;
  std::string address;
  std::string model = "auto";
  bool gripper = true;
  double hold_time = 2;  // s
  std::optional<int> processor;  // for the loop
  bool lockstep = false;         // a simulated arm that waits for each command: nothing needs real-time priority
  LimitsConfig limits;
  RecoveryConfig recovery;
  robot::Settings settings;  // load, tool where given; collision behaviour, that of robot::kCollisionBehavior by default
  std::vector<frankapy::proto::Wall> walls;
};

// What is written to disk, of all arms.
struct RecordingsConfig {
  enum class Mode {
    kOff,
    kErrors,  // the black box: ten seconds before each error
    kSkills,  // that, and each skill
    kAlways,  // that, and everything
  };
  Mode mode = Mode::kErrors;
  std::string folder;  // of all arms; each has one in it. By default in the user's data folder ($XDG_DATA_HOME)
  double max_gb = 10;  // of an arm's files; then the oldest go
  double file_mb = 500, file_minutes = 10;  // of one file, before the next one begins
};

struct Config {
  std::string listen = "127.0.0.1";
  std::uint16_t port = 5757;
  std::vector<ArmConfig> arms;
  RecordingsConfig recordings;
  std::vector<std::string> load;  // libraries of parts, as written
  std::string keys;               // folder of Keys, as written; empty: as keys_for() says
};

// Says file, line, key, what was found and what was expected.
class ConfigError : public std::runtime_error {
 public:
  using runtime_error::runtime_error;
};

// Reads TOML text; `source` names it in errors. Throws ConfigError.
Config parse_config(const std::string& text, const std::string& source);

// The whole file as text. Throws ConfigError, also where it does not end within a megabyte.
std::string read_config_file(const std::string& path);
std::string read_config(std::istream& from, const std::string& source);

// TOML of a server with one arm and defaults otherwise.
std::string config_of_robot(const std::string& address, bool gripper);

// The folder of the user's data, where what the server keeps is by default ($XDG_DATA_HOME).
std::string data_folder();

// Where those of its walls are that are to be kept.
std::string walls_file(const ArmConfig& arm);

// The folder of the user's configuration ($XDG_CONFIG_HOME).
std::string config_folder();

// The mode of that name. Throws ConfigError.
RecordingsConfig::Mode recording_mode(const std::string& name);

}  // namespace server
