#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "server/config.hpp"

namespace server {

struct ArmOptions {
  // What the supervisor gives to its children, and an exit status of theirs.
  // See status_fd; memory of a PartRecord, of a BlackBox, of a WallStore, of a LimitStore.
  static constexpr int kStatusFd = 3, kRecordFd = 4, kBlackBoxFd = 5, kWallsFd = 6, kLimitsFd = 7;
  static constexpr int kHangs = 3;                    // a thread hung

  // A thread of an arm's process that is silent for longer hangs. The loop waits at most 1 s for the robot.
  struct Watchdogs {
    std::chrono::milliseconds transport{1000}, loop{1500};
    std::chrono::milliseconds part{500};     // the loop, in one step of a part: more than a busy computer makes a thread wait
    std::chrono::milliseconds builder{2000};  // in a part's constructor, or while its path is looked at
  };

  int index = 0;              // among the arms of this computer
  std::string listen = "127.0.0.1";
  std::string keys;              // folder of Keys; empty: see keys_for()
  std::uint16_t port = 0;        // of requests; a free one where 0 or taken
  std::uint16_t state_port = 0;  // of states; likewise
  std::uint16_t sensor_port = 0;  // of sensor messages; likewise
  int status_fd = -1;            // SOCK_SEQPACKET to the supervisor, which gets an Arms.Arm ten times a
                                 // second: what clients are told, and that this process lives
  std::uint64_t (*allocations)() noexcept = nullptr;  // that the calling thread has made so far; null: not known
  Watchdogs watchdogs;
};

// Serves one arm until SIGINT or SIGTERM, or until the supervisor is gone; connects to the robot, again
// and again where it is not there. Returns the program's exit status.
int run_arm(const ArmConfig& config, const RecordingsConfig& recordings, const ArmOptions& options);

}  // namespace server
