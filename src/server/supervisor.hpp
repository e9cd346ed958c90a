#pragma once

#include <chrono>
#include <string>

#include "server/config.hpp"
#include "server/keys.hpp"

namespace server {

// What the supervisor waits for of an arm's process.
struct SupervisorTimes {
  std::chrono::milliseconds silence{1000};      // of one that was heard before: it hangs
  std::chrono::milliseconds first_word{10000};  // of a new one, when its libraries are loaded
  std::chrono::milliseconds short_life{1000};   // one that ends sooner is started again so long after it was
  std::chrono::milliseconds stop{6000};         // to brake, finish and end
};

// One process per arm: starts them, tells clients where they are (ListArms), and starts those again
// that end or hang, without touching the others. Ends on SIGINT or SIGTERM, when the arms have braked
// and their motions are finished. `toml` is the text that `config` was read from: the arms' processes
// read it too, and get `arguments` beside their own. `keys` may be null: see Listen. Prints "listening on <endpoint>" as its first
// line. Returns the program's exit status.
int run_supervisor(const Config& config, const std::string& toml, const std::vector<std::string>& arguments, Keys* keys = nullptr,
                   const SupervisorTimes& times = {});

}  // namespace server
