#pragma once

#include <chrono>
#include <string>
#include <unordered_map>

#include "frankapy/proto/service.pb.h"
#include "server/answers.hpp"
#include "server/clock_estimate.hpp"

namespace server {

// Who has said Hello, and which of them has the lease: the one that may command. It is taken with the first command, and freed by
// Goodbye or silence.
class Clients {
 public:
  using Duration = std::chrono::steady_clock::duration;

  struct Client {
    std::string name;
    std::string key;  // of its connection; empty: there are none
    Duration last_heard;
    ClockEstimate clock = {};
  };

  // `lease_time`: of a client's silence, after which its lease is free.
  explicit Clients(std::chrono::milliseconds lease_time) : lease_time_(lease_time) {}

  // From here on it is `now`, by a clock that does not go back.
  void set_time(Duration now) { now_ = now; }
  // It has sent something.
  void hear(const std::string& client, const std::string& key);
  // It has said Hello. An identity is anybody's choice: what one with another key had under it is gone.
  void come(const Address& from, const std::string& name);
  void leave(const Address& from);

  // Throws Refused for one that has not said Hello, with this key.
  Client& known(const Address& from);
  // Of one that has; else empty.
  std::string name(const Address& from) const;

  // Throws Refused where another one has it.
  void require_lease(const Address& from) const;
  void take_lease(const Address& from);
  // Whether the one that had it has lost it by its silence.
  bool expire_lease();
  // Whether it has gone, or been silent for as long.
  bool is_silent(const std::string& client, std::chrono::milliseconds time) const;

  void describe(frankapy::proto::ServerStatus& status) const;

 private:
  const std::chrono::milliseconds lease_time_;
  Duration now_{};
  std::unordered_map<std::string, Client> clients_;  // by identity
  std::string commander_;                            // identity; empty: the lease is free
};

}  // namespace server
