#pragma once

#include <string>

#include "server/config.hpp"

namespace server {

// One process per arm: starts them, tells clients where they are (ListArms), and starts those again
// that end or hang, without touching the others. Ends on SIGINT or SIGTERM, when the arms have braked
// and their motions are finished. `toml` is the text that `config` was read from: the arms' processes
// read it too, and get `arguments` beside their own. Prints "listening on <endpoint>" as its first line. Returns the program's
// exit status.
int run_supervisor(const Config& config, const std::string& toml, const std::vector<std::string>& arguments);

}  // namespace server
