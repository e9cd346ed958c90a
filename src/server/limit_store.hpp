#pragma once

#include <memory>

#include "frankapy/proto/limits.pb.h"
#include "realtime/bounds.hpp"
#include "server/config.hpp"

namespace server {

// What bounds the motions and torques that are asked for: at most what the connected arm and the configuration, or in its place
// role lab, allow, and what of that a client has reduced. It makes of that what the loop has. The loop is built with the
// configuration's velocity, acceleration and jerk, so that nobody raises these beyond.
class LimitStore {
 public:
  // What clients have set is kept in a file that outlives this process (-1: none).
  explicit LimitStore(const LimitsConfig& lab = {}, int fd = -1);

  // The arm's limits, with the configuration's factors in them.
  void connect(const models::Limits& arm);

  // Throws Refused where it is more than is allowed; nothing is changed then.
  void change(const frankapy::proto::ChangeLimits& change);

  frankapy::proto::LimitsInForce list() const;

  realtime::Bounds make() const;

 private:
  void set_most();

  LimitsConfig lab_;
  int fd_;
  models::Limits arm_{};
  frankapy::proto::Limits allowed_, most_;  // what role lab may allow, and what is
  frankapy::proto::ChangeLimits given_;     // by clients
};

}  // namespace server
