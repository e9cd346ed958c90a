#include "server/config.hpp"

#include <arpa/inet.h>
#include <sched.h>
#include <spdlog/fmt/fmt.h>
#include <toml++/toml.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <istream>
#include <set>
#include <sstream>
#include <utility>

#include "models/arm.hpp"
#include "robot/collision_behavior.hpp"
#include "server/refused.hpp"
#include "server/wall_store.hpp"

namespace server {
namespace {

constexpr std::pair<const char*, RecordingsConfig::Mode> kRecordingModes[] = {{"off", RecordingsConfig::Mode::kOff},
                                                                              {"errors", RecordingsConfig::Mode::kErrors},
                                                                              {"skills", RecordingsConfig::Mode::kSkills},
                                                                              {"always", RecordingsConfig::Mode::kAlways}};
constexpr std::size_t kMaxFile = 1 << 20;  // bytes
constexpr char kRecordingModesExpected[] = "\"off\", \"errors\", \"skills\" or \"always\"";

std::string text_of(const toml::node& node) {
  std::ostringstream text;
  node.visit([&](const auto& value) { text << value; });
  return text.str();
}

// One table of the file. Every key is asked for by name; finish() refuses the others.
class Table {
 public:
  Table(const toml::table& table, std::string source, std::string path)
      : table_(table), source_(std::move(source)), path_(std::move(path)) {}

  [[noreturn]] void fail(const toml::node& at, const std::string& text) const {
    throw ConfigError(fmt::format("{}:{}: {}", source_, at.source().begin.line, text));
  }
  [[noreturn]] void refuse(const toml::node& at, const std::string& key, const std::string& expected) const {
    fail(at, fmt::format("{} = {}: expected {}", full(key), text_of(at), expected));
  }

  const toml::node* find(const std::string& key) {
    known_.push_back(key);
    return table_.get(key);
  }
  const toml::node& require(const std::string& key, const std::string& expected) {
    const auto* node = find(key);
    if (node == nullptr) fail(table_, fmt::format("{} is missing: expected {}", full(key), expected));
    return *node;
  }

  // Nothing when the key is not there.
  const toml::table* table(const std::string& key) {
    const auto* node = find(key);
    if (node != nullptr && !node->is_table()) refuse(*node, key, "a table");
    return node == nullptr ? nullptr : node->as_table();
  }

  std::string text(const toml::node& node, const std::string& key, const std::string& expected) const {
    const auto value = node.value_exact<std::string>();
    if (!value || value->empty()) refuse(node, key, expected);
    return *value;
  }
  bool boolean(const toml::node& node, const std::string& key) const {
    const auto value = node.value_exact<bool>();
    if (!value) refuse(node, key, "true or false");
    return *value;
  }
  double number(const toml::node& node, const std::string& key, double min, double max,
                const std::string& expected) const {
    const auto value = node.is_number() ? node.value<double>() : std::nullopt;
    if (!value || !std::isfinite(*value) || *value < min || *value > max) refuse(node, key, expected);
    return *value;
  }
  template <std::size_t N>
  std::array<double, N> numbers(const toml::node& node, const std::string& key, double min, double max,
                                const std::string& what) const {
    const std::string expected = fmt::format("{} {}", N, what);
    const auto* array = node.as_array();
    if (array == nullptr || array->size() != N) refuse(node, key, expected);
    std::array<double, N> values;
    for (std::size_t i = 0; i < N; ++i) values[i] = number((*array)[i], fmt::format("{}[{}]", key, i), min, max, what);
    return values;
  }

  void finish() const {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (std::find(known_.begin(), known_.end(), name) != known_.end()) continue;
      throw ConfigError(fmt::format("{}:{}: unknown key {}; known are {}", source_, key.source().begin.line,
                                    full(name), fmt::join(known_, ", ")));
    }
  }

  std::string full(const std::string& key) const { return path_.empty() ? key : path_ + "." + key; }
  const std::string& source() const { return source_; }
  const toml::table& node() const { return table_; }

 private:
  const toml::table& table_;
  std::string source_, path_;
  std::vector<std::string> known_;
};

void read_server(const toml::table& node, const std::string& source, Config& config) {
  Table table(node, source, "server");
  if (const auto* listen = table.find("listen")) {
    config.listen = table.text(*listen, "listen", kListenExpected);
    if (!is_address(config.listen)) table.refuse(*listen, "listen", kListenExpected);
  }
  if (const auto* port = table.find("port")) {
    const std::string expected = "a whole number, 0 to 65535";
    if (!port->is_integer()) table.refuse(*port, "port", expected);
    config.port = static_cast<std::uint16_t>(table.number(*port, "port", 0, 65535, expected));
  }
  table.finish();
}

void read_keys(const toml::table& node, const std::string& source, Config& config) {
  Table table(node, source, "keys");
  const std::string expected = "the folder that `frankapy keys new` has made";
  config.keys = table.text(table.require("folder", expected), "folder", expected);
  table.finish();
}

void read_recordings(const toml::table& node, const std::string& source, RecordingsConfig& recordings) {
  Table table(node, source, "recordings");
  if (const auto* mode = table.find("mode")) {
    const std::string name = table.text(*mode, "mode", kRecordingModesExpected);
    try {
      recordings.mode = recording_mode(name);
    } catch (const ConfigError&) {
      table.refuse(*mode, "mode", kRecordingModesExpected);
    }
  }
  if (const auto* folder = table.find("folder")) recordings.folder = table.text(*folder, "folder", "a folder of the server's computer");
  const auto number = [&](const char* key, double& value, double min, double max, const std::string& expected) {
    if (const auto* found = table.find(key)) value = table.number(*found, key, min, max, expected);
  };
  number("max_gb", recordings.max_gb, 0.01, 1e6, "0.01 to 1e6 GB");
  number("file_mb", recordings.file_mb, 1, 1e5, "1 to 1e5 MB");
  number("file_minutes", recordings.file_minutes, 0.1, 1e4, "0.1 to 1e4 minutes");
  table.finish();
}

fci::SetLoad read_load(const toml::table& node, const std::string& source) {
  Table table(node, source, "arm.load");
  fci::SetLoad load;
  load.m_load = table.number(table.require("mass", "kg"), "mass", 0, 20, "0 to 20 kg");
  if (const auto* center = table.find("center_of_mass")) {
    load.F_x_Cload = table.numbers<3>(*center, "center_of_mass", -2, 2, "numbers, -2 to 2 m");
  }
  if (const auto* inertia = table.find("inertia")) {
    load.I_load = table.numbers<9>(*inertia, "inertia", -100, 100, "numbers, -100 to 100 kg m²");
    const Eigen::Map<const Eigen::Matrix3d> matrix(load.I_load.data());
    if (!matrix.isApprox(matrix.transpose(), 1e-9) && !matrix.isZero()) {
      table.refuse(*inertia, "inertia", "a symmetric 3x3 matrix");
    }
    if (Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(matrix).eigenvalues().minCoeff() < -1e-12) {
      table.refuse(*inertia, "inertia", "a positive definite 3x3 matrix");
    }
  }
  table.finish();
  return load;
}

Eigen::Quaterniond read_quaternion(const Table& table, const toml::node& node) {
  const auto q = table.numbers<4>(node, "quaternion", -1.01, 1.01, "numbers w, x, y, z of norm 1");
  const Eigen::Quaterniond rotation(q[0], q[1], q[2], q[3]);
  if (std::abs(rotation.norm() - 1) > 1e-3) table.refuse(node, "quaternion", "4 numbers w, x, y, z of norm 1");
  return rotation.normalized();
}

fci::SetNEToEE read_tool(const toml::table& node, const std::string& source) {
  Table table(node, source, "arm.tool");
  Eigen::Isometry3d NE_T_EE = Eigen::Isometry3d::Identity();
  if (const auto* translation = table.find("translation")) {
    NE_T_EE.translation() =
        Eigen::Vector3d(table.numbers<3>(*translation, "translation", -2, 2, "numbers, -2 to 2 m").data());
  }
  if (const auto* quaternion = table.find("quaternion")) {
    NE_T_EE.linear() = read_quaternion(table, *quaternion).toRotationMatrix();
  }
  table.finish();
  fci::SetNEToEE tool;
  Eigen::Map<Eigen::Matrix4d>(tool.NE_T_EE.data()) = NE_T_EE.matrix();
  return tool;
}

fci::SetCollisionBehavior read_collision(const toml::table& node, const std::string& source) {
  Table table(node, source, "arm.collision");
  const std::string torque = "numbers, 0 to 1000 N m", force = "numbers, 0 to 1000 N and N m";
  const auto torques = [&](const char* key) {
    return table.numbers<7>(table.require(key, "7 " + torque), key, 0, 1000, torque);
  };
  const auto forces = [&](const char* key) {
    return table.numbers<6>(table.require(key, "6 " + force), key, 0, 1000, force);
  };
  fci::SetCollisionBehavior behavior;
  behavior.lower_torque_thresholds_nominal = torques("lower_torque_thresholds");
  behavior.upper_torque_thresholds_nominal = torques("upper_torque_thresholds");
  behavior.lower_force_thresholds_nominal = forces("lower_force_thresholds");
  behavior.upper_force_thresholds_nominal = forces("upper_force_thresholds");
  behavior.lower_torque_thresholds_acceleration = behavior.lower_torque_thresholds_nominal;
  behavior.upper_torque_thresholds_acceleration = behavior.upper_torque_thresholds_nominal;
  behavior.lower_force_thresholds_acceleration = behavior.lower_force_thresholds_nominal;
  behavior.upper_force_thresholds_acceleration = behavior.upper_force_thresholds_nominal;
  table.finish();
  const auto check = [&](const auto& lower, const auto& upper, const char* kind) {
    for (std::size_t i = 0; i < lower.size(); ++i) {
      if (lower[i] <= upper[i]) continue;
      table.fail(node, fmt::format("arm.collision.lower_{0}_thresholds[{1}] = {2}: expected at most the upper one, {3}",
                                   kind, i, lower[i], upper[i]));
    }
  };
  check(behavior.lower_torque_thresholds_nominal, behavior.upper_torque_thresholds_nominal, "torque");
  check(behavior.lower_force_thresholds_nominal, behavior.upper_force_thresholds_nominal, "force");
  return behavior;
}

void read_limits(const toml::table& node, const std::string& source, ArmConfig& arm) {
  Table table(node, source, "arm.limits");
  const auto factor = [&](const char* key, double& value) {
    const auto* found = table.find(key);
    if (found != nullptr) value = table.number(*found, key, 0.01, 1, "a factor, 0.01 to 1");
  };
  factor("velocity", arm.limits.velocity);
  factor("acceleration", arm.limits.acceleration);
  factor("jerk", arm.limits.jerk);
  factor("torque", arm.limits.torque);
  const auto figure = [&](const char* key, std::optional<double>& value, double min, double max, const std::string& expected) {
    if (const auto* found = table.find(key)) value = table.number(*found, key, min, max, expected);
  };
  figure("tool_speed", arm.limits.tool_speed, 0.01, 10, "0.01 to 10 m/s");
  figure("power", arm.limits.power, 1, 10000, "1 to 10000 W");
  table.finish();
}

void read_recovery(const toml::table& node, const std::string& source, RecoveryConfig& recovery) {
  using Policy = frankapy::proto::RecoveryPolicy;
  Table table(node, source, "arm.recovery");
  const auto who = [&](const char* key, Policy::Who& value, bool never) {
    const auto* found = table.find(key);
    if (found == nullptr) return;
    const std::string expected = never ? "\"itself\", \"ask\" or \"never\"" : "\"itself\" or \"ask\"";
    const std::string name = table.text(*found, key, expected);
    if (name == "itself") {
      value = Policy::ITSELF;
    } else if (name == "ask") {
      value = Policy::ASK;
    } else if (name == "never" && never) {
      value = Policy::NEVER;
    } else {
      table.refuse(*found, key, expected);
    }
  };
  who("errors", recovery.errors, true);
  who("collisions", recovery.collisions, true);
  who("user_stop", recovery.user_stop, false);  // nobody else could
  if (const auto* times = table.find("times")) {
    const std::string expected = "a whole number, 1 to 1000";
    if (!times->is_integer()) table.refuse(*times, "times", expected);
    recovery.times = static_cast<unsigned>(table.number(*times, "times", 1, 1000, expected));
  }
  table.finish();
}

frankapy::proto::Wall read_wall(const toml::table& node, const std::string& source) {
  Table table(node, source, "arm.wall");
  frankapy::proto::Wall wall;
  wall.set_name(table.text(table.require("name", "a name"), "name", "a name"));
  const std::string shapes = "\"plane\", \"box\", \"sphere\", \"cylinder\", \"capsule\" or \"mesh\"";
  const auto& shape = table.require("shape", shapes);
  const std::string name = table.text(shape, "shape", shapes);
  const auto length = [&](const char* key, double min) {
    const std::string expected = fmt::format("{} to 10 m", min);
    return table.number(table.require(key, expected), key, min, 10, expected);
  };
  const auto round = [&](auto& body, double shortest) {
    body.set_radius(length("radius", 0.001));
    body.set_length(length("length", shortest));
  };
  if (name == "plane") {
    wall.mutable_plane();
  } else if (name == "box") {
    for (double edge : table.numbers<3>(table.require("size", "3 edges, m"), "size", 0.001, 10, "edges, 0.001 to 10 m")) {
      wall.mutable_box()->add_size(edge);
    }
  } else if (name == "sphere") {
    wall.mutable_sphere()->set_radius(length("radius", 0.001));
  } else if (name == "cylinder") {
    round(*wall.mutable_cylinder(), 0.001);
  } else if (name == "capsule") {
    round(*wall.mutable_capsule(), 0);
  } else if (name == "mesh") {
    const auto rows = [&](const char* key, double min, double max, const std::string& what, const auto& add) {
      const toml::node& node = table.require(key, "a list of " + what);
      if (!node.is_array()) table.refuse(node, key, "a list of " + what);
      for (const auto& row : *node.as_array()) {
        for (double each : table.numbers<3>(row, key, min, max, what)) add(each);
      }
    };
    auto& mesh = *wall.mutable_mesh();
    rows("corners", -10, 10, "numbers x, y, z, -10 to 10 m", [&](double each) { mesh.add_corners(each); });
    const std::string of_corners = "whole numbers of corners";
    rows("triangles", 0, 1000, of_corners, [&](double each) {
      if (each != std::trunc(each)) table.refuse(table.require("triangles", of_corners), "triangles", of_corners);
      mesh.add_triangles(static_cast<std::uint32_t>(each));
    });
  } else {
    table.refuse(shape, "shape", shapes);
  }
  std::array<double, 3> position{};
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  if (const auto* given = table.find("position")) position = table.numbers<3>(*given, "position", -10, 10, "numbers, -10 to 10 m");
  if (const auto* given = table.find("quaternion")) orientation = read_quaternion(table, *given);
  for (double each : position) wall.add_position(each);
  for (double each : {orientation.w(), orientation.x(), orientation.y(), orientation.z()}) wall.add_orientation(each);
  if (const auto* held = table.find("held")) wall.set_held(table.boolean(*held, "held"));
  table.finish();
  try {
    WallStore store({wall});
  } catch (const Refused& refused) {
    table.fail(node, refused.what());
  }
  return wall;
}

ArmConfig read_arm(const toml::table& node, const std::string& source) {
  Table table(node, source, "arm");
  ArmConfig arm;
  const std::string name_expected = "a name of letters, digits, \"_\" and \"-\"";
  const auto& name = table.require("name", name_expected);
  arm.name = table.text(name, "name", name_expected);
  const auto valid = [](unsigned char c) { return std::isalnum(c) || c == '_' || c == '-'; };
  if (!std::all_of(arm.name.begin(), arm.name.end(), valid)) table.refuse(name, "name", name_expected);

  const std::string address_expected = "the robot's address, such as \"172.16.0.2\"";
  arm.address = table.text(table.require("address", address_expected), "address", address_expected);
  if (const auto* model = table.find("model")) {
    std::string known = "\"auto\"";
    for (const auto& each : models::arms()) known += fmt::format(", \"{}\"", each.name);
    arm.model = table.text(*model, "model", "one of " + known);
    const auto is_its = [&](const models::Arm& each) { return each.name == arm.model; };
    if (arm.model != "auto" && std::ranges::none_of(models::arms(), is_its)) table.refuse(*model, "model", "one of " + known);
  }
  if (const auto* gripper = table.find("gripper")) arm.gripper = table.boolean(*gripper, "gripper");
  if (const auto* hold = table.find("hold_time")) {
    arm.hold_time = table.number(*hold, "hold_time", 0, 3600, "0 to 3600 s");
  }
  if (const auto* lockstep = table.find("lockstep")) arm.lockstep = table.boolean(*lockstep, "lockstep");
  if (const auto* processor = table.find("processor")) {
    const std::string expected = "the number of a processor, from 0";
    if (!processor->is_integer()) table.refuse(*processor, "processor", expected);
    arm.processor = static_cast<int>(table.number(*processor, "processor", 0, CPU_SETSIZE - 1, expected));
  }
  if (const auto* load = table.table("load")) arm.settings.load = read_load(*load, source);
  if (const auto* tool = table.table("tool")) arm.settings.NE_T_EE = read_tool(*tool, source);
  if (const auto* limits = table.table("limits")) read_limits(*limits, source, arm);
  if (const auto* recovery = table.table("recovery")) read_recovery(*recovery, source, arm.recovery);
  const auto* collision = table.table("collision");
  arm.settings.collision_behavior = collision != nullptr ? read_collision(*collision, source) : robot::kCollisionBehavior;
  if (const auto* walls = table.find("wall")) {
    const auto* list = walls->as_array();
    if (list == nullptr || !list->is_homogeneous<toml::table>()) table.fail(*walls, "arm.wall: expected one [[arm.wall]] for each wall");
    std::set<std::string> names;
    for (const auto& each : *list) {
      arm.walls.push_back(read_wall(*each.as_table(), source));
      if (!names.insert(arm.walls.back().name()).second) {
        table.fail(each, fmt::format("arm.wall.name = '{}': another wall has this name", arm.walls.back().name()));
      }
    }
    try {
      WallStore store(arm.walls);
    } catch (const Refused& refused) {
      table.fail(*walls, fmt::format("arm.wall: {}", refused.what()));
    }
  }
  table.finish();
  return arm;
}

}  // namespace

bool is_address(const std::string& listen) {
  in_addr address;
  return inet_pton(AF_INET, listen.c_str(), &address) == 1;
}

Config parse_config(const std::string& text, const std::string& source) {
  toml::table root;
  try {
    root = toml::parse(text, source);
  } catch (const toml::parse_error& error) {
    throw ConfigError(fmt::format("{}:{}: not TOML: {}", source, error.source().begin.line, error.description()));
  }
  Config config;
  Table table(root, source, "");
  if (const auto* server = table.table("server")) read_server(*server, source, config);
  if (const auto* keys = table.table("keys")) read_keys(*keys, source, config);
  if (const auto* recordings = table.table("recordings")) read_recordings(*recordings, source, config.recordings);
  if (config.recordings.folder.empty()) config.recordings.folder = data_folder() + "/franka-interface/recordings";
  if (const auto* load = table.find("load")) {
    const std::string expected = "a list of libraries of parts, such as [\"build/liblqr.so\"]";
    const auto* list = load->as_array();
    if (list == nullptr) table.refuse(*load, "load", expected);
    for (const auto& each : *list) config.load.push_back(table.text(each, "load", expected));
  }
  const auto& arms = table.require("arm", "at least one [[arm]] with name and address");
  const auto* list = arms.as_array();
  if (list == nullptr || list->empty() || !list->is_homogeneous<toml::table>()) {
    table.fail(arms, "arm: expected one [[arm]] (in double brackets) for each arm");
  }
  std::set<std::string> names, addresses;
  for (const auto& each : *list) {
    ArmConfig arm = read_arm(*each.as_table(), source);
    if (!names.insert(arm.name).second) {
      table.fail(each, fmt::format("arm.name = '{}': another arm has this name", arm.name));
    }
    if (!addresses.insert(arm.address).second) {
      table.fail(each, fmt::format("arm.address = '{}': another arm has this address", arm.address));
    }
    config.arms.push_back(std::move(arm));
  }
  table.finish();
  return config;
}

std::string read_config_file(const std::string& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    throw ConfigError(path + ": is a folder: expected a TOML file that names the arms");
  }
  std::ifstream file(path);
  if (!file) {
    throw ConfigError(fmt::format("{}: cannot be read ({}): expected a TOML file that names the arms", path,
                                  std::strerror(errno)));
  }
  return read_config(file, path);
}

std::string read_config(std::istream& from, const std::string& source) {
  std::string text(kMaxFile + 1, 0);
  from.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(from.gcount()));
  if (text.size() > kMaxFile) {
    throw ConfigError(fmt::format("{}: more than {} bytes: expected a TOML file that names the arms", source, kMaxFile));
  }
  return text;
}

std::string data_folder() {
  const char* data = std::getenv("XDG_DATA_HOME");
  if (data != nullptr && *data != 0) return data;
  const char* home = std::getenv("HOME");
  return fmt::format("{}/.local/share", home != nullptr && *home != 0 ? home : "/var/lib");
}

std::string walls_file(const ArmConfig& arm) {
  return fmt::format("{}/franka-interface/walls/{}@{}", data_folder(), arm.name, arm.address);
}

std::string config_folder() {
  const char* config = std::getenv("XDG_CONFIG_HOME");
  if (config != nullptr && *config != 0) return config;
  const char* home = std::getenv("HOME");
  return home != nullptr && *home != 0 ? fmt::format("{}/.config", home) : "/etc";
}

RecordingsConfig::Mode recording_mode(const std::string& name) {
  for (const auto& [known, mode] : kRecordingModes) {
    if (name == known) return mode;
  }
  throw ConfigError(fmt::format("recordings: \"{}\": expected {}", name, kRecordingModesExpected));
}

std::string config_of_robot(const std::string& address, bool gripper) {
  toml::table arm{{"name", "arm"}, {"address", address}, {"gripper", gripper}};
  std::ostringstream text;
  text << toml::table{{"arm", toml::array{std::move(arm)}}};
  return text.str();
}

}  // namespace server
