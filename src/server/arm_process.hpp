#pragma once

#include <cstdint>
#include <string>

#include "server/config.hpp"

namespace server {

struct ArmOptions {
  int index = 0;              // among the arms of this computer
  std::string listen = "127.0.0.1";
  std::uint16_t port = 0;        // of requests; a free one where 0 or taken
  std::uint16_t state_port = 0;  // of states; likewise
  int status_fd = -1;            // SOCK_SEQPACKET to the supervisor, which gets an Arms.Arm ten times a
                                 // second: what clients are told, and that this process lives
};

// Serves one arm until SIGINT or SIGTERM, or until the supervisor is gone; connects to the robot, again
// and again where it is not there. Returns the program's exit status.
int run_arm(const ArmConfig& config, const ArmOptions& options);

}  // namespace server
