// franka-interface: the server. See ARCHITECTURE.md, "Processes".

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <iterator>

#include "server/arm_process.hpp"
#include "server/config.hpp"
#include "server/supervisor.hpp"

int main(int argc, char** argv) {
  CLI::App app("Serves Franka arms to frankapy. Give the arm's address, or a file that names the arms.");
  std::string config_file, robot, listen;
  int port = -1;
  bool gripper = true;
  auto* config_option = app.add_option("--config", config_file, "TOML file of the server and its arms");
  app.add_option("--robot", robot, "address of one robot, instead of a file")->excludes(config_option);
  app.add_option("--listen", listen, "address of this computer to serve at (default 127.0.0.1; 0.0.0.0: all)");
  app.add_option("--port", port, "port to serve at (default 5757; 0: a free one, printed first)")
      ->check(CLI::Range(0, 65535));
  app.add_flag("--gripper,!--no-gripper", gripper, "look for a Franka hand (default), with --robot");

  server::ArmOptions arm;
  bool supervised = false;
  auto* arm_command = app.add_subcommand("arm", "one arm of the configuration on standard input");
  arm_command->group("");  // the supervisor's own
  arm_command->add_option("--index", arm.index)->required();
  arm_command->add_option("--listen", arm.listen);
  arm_command->add_option("--port", arm.port);
  arm_command->add_option("--state-port", arm.state_port);
  arm_command->add_flag("--supervised", supervised);
  CLI11_PARSE(app, argc, argv);

  spdlog::set_default_logger(spdlog::stderr_color_mt("franka-interface"));
  spdlog::set_pattern("[%H:%M:%S.%e] %^%l%$ %v");
  try {
    if (*arm_command) {
      const std::string toml(std::istreambuf_iterator<char>(std::cin), {});
      const auto config = server::parse_config(toml, "standard input");
      if (supervised) arm.status_fd = 3;
      return server::run_arm(config.arms.at(arm.index), arm);
    }
    if (config_file.empty() && robot.empty()) {
      throw server::ConfigError("which arm? Give --robot ADDRESS, or --config FILE (TOML); see --help");
    }
    const std::string toml = config_file.empty() ? server::config_of_robot(robot, gripper)
                                                 : server::read_config_file(config_file);
    auto config = server::parse_config(toml, config_file.empty() ? "command line" : config_file);
    if (!listen.empty()) config.listen = listen;
    if (port >= 0) config.port = static_cast<std::uint16_t>(port);
    return server::run_supervisor(config, toml);
  } catch (const std::exception& error) {
    spdlog::critical("{}", error.what());
    return EXIT_FAILURE;
  }
}
