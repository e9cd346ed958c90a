// franka-interface: the server. See ARCHITECTURE.md, "Processes".

#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>

#include "allocations/allocations.hpp"
#include "server/arm_process.hpp"
#include "server/config.hpp"
#include "server/keys.hpp"
#include "server/log.hpp"
#include "server/plugins.hpp"
#include "server/supervisor.hpp"
#include "server/wall_store.hpp"

int main(int argc, char** argv) {
  CLI::App app("Serves Franka arms to frankapy. Give the arm's address, or a file that names the arms.");
  std::string config_file, robot, listen, keys;
  int port = -1;
  std::vector<std::string> load;
  bool gripper = true;
  auto* config_option = app.add_option("--config", config_file, "TOML file of the server and its arms");
  app.add_option("--robot", robot, "address of one robot, instead of a file")->excludes(config_option);
  app.add_option("--listen", listen, "address of this computer to serve at (default 127.0.0.1; 0.0.0.0: all)");
  app.add_option("--port", port, "port to serve at (default 5757; 0: a free one, printed first)")
      ->check(CLI::Range(0, 65535));
  app.add_flag("--gripper,!--no-gripper", gripper, "look for a Franka hand (default), with --robot");

  std::string record, recordings;
  app.add_option("--record", record, "what is recorded: off, errors (default: ten seconds before each), skills, always");
  app.add_option("--recordings", recordings, "folder of the recordings")->type_name("FOLDER");
  app.add_option("--keys", keys, "folder of keys (`frankapy keys new`): only clients whose key is there connect")->type_name("FOLDER");
  app.add_option("--load", load, "library of parts of your own, for all arms; once for each");

  server::ArmOptions arm;
  bool supervised = false;
  auto* arm_command = app.add_subcommand("arm", "one arm of the configuration on standard input");
  arm_command->group("");  // the supervisor's own
  arm_command->add_option("--index", arm.index)->required();
  arm_command->add_option("--listen", arm.listen);
  arm_command->add_option("--port", arm.port);
  arm_command->add_option("--state-port", arm.state_port);
  arm_command->add_option("--sensor-port", arm.sensor_port);
  arm_command->add_option("--load", load);
  arm_command->add_option("--keys", arm.keys);
  arm_command->add_option("--record", record);
  arm_command->add_option("--recordings", recordings);
  arm_command->add_flag("--supervised", supervised);
  CLI11_PARSE(app, argc, argv);

  const auto choose_recordings = [&](server::Config& config) {
    if (!record.empty()) config.recordings.mode = server::recording_mode(record);
    if (!recordings.empty()) config.recordings.folder = std::filesystem::absolute(recordings);
  };

  server::start_log();
  try {
    if (*arm_command) {
      auto config = server::parse_config(server::read_config(std::cin, "standard input"), "standard input");
      choose_recordings(config);
      if (supervised) arm.status_fd = server::ArmOptions::kStatusFd;
      if (allocations::kCounts) arm.allocations = allocations::of_this_thread;
      for (const auto& path : load) server::load_parts(path);
      return server::run_arm(config.arms.at(arm.index), config.recordings, arm);
    }
    if (config_file.empty() && robot.empty()) {
      throw server::ConfigError("which arm? Give --robot ADDRESS, or --config FILE (TOML); see --help");
    }
    const std::string toml = config_file.empty() ? server::config_of_robot(robot, gripper)
                                                 : server::read_config_file(config_file);
    auto config = server::parse_config(toml, config_file.empty() ? "command line" : config_file);
    if (!listen.empty()) {
      if (!server::is_address(listen)) throw server::ConfigError("--listen is \"" + listen + "\": expected " + server::kListenExpected);
      config.listen = listen;
    }
    if (port >= 0) config.port = static_cast<std::uint16_t>(port);
    choose_recordings(config);
    if (!keys.empty()) config.keys = std::filesystem::absolute(keys);
    // Here relative to the working folder, in the file to the file's.
    for (auto& path : load) path = std::filesystem::absolute(path);
    const auto folder = std::filesystem::absolute(std::filesystem::path(config_file).parent_path() / ".");
    for (const auto& path : config.load) load.push_back((folder / path).lexically_normal());
    if (!config.keys.empty()) config.keys = (folder / config.keys).lexically_normal();
    config.recordings.folder = (folder / config.recordings.folder).lexically_normal();
    const auto known = server::keys_for(config.listen, config.keys);
    server::try_parts(load);
    for (const auto& each : config.arms) server::kept_walls(server::walls_file(each));
    std::vector<std::string> arguments = {"--recordings", config.recordings.folder};
    if (!record.empty()) arguments.insert(arguments.end(), {"--record", record});
    for (const auto& path : load) arguments.insert(arguments.end(), {"--load", path});
    if (known) arguments.insert(arguments.end(), {"--keys", known->folder()});
    return server::run_supervisor(config, toml, arguments, known.get());
  } catch (const std::exception& error) {
    spdlog::critical("{}", error.what());
    return EXIT_FAILURE;
  }
}
