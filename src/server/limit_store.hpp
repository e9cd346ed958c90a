#pragma once

#include <memory>

#include "frankapy/proto/limits.pb.h"
#include "realtime/bounds.hpp"
#include "server/config.hpp"

namespace server {

// What bounds the motions and torques that are asked for: at most what the configuration and the connected arm allow, and what of
// that a client has reduced. It makes of that what the loop has.
class LimitStore {
 public:
  // What a client has reduced is kept in a file that outlives this process (-1: none).
  explicit LimitStore(const LimitsConfig& lab = {}, int fd = -1);

  // The arm's limits, with the configuration's factors in them.
  void connect(const models::Limits& arm);

  // Throws Refused where it is more than is allowed; nothing is changed then.
  void change(const frankapy::proto::ChangeLimits& change);

  frankapy::proto::LimitsInForce list() const;

  realtime::Bounds make() const;

 private:
  LimitsConfig lab_;
  int fd_;
  models::Limits arm_{};
  frankapy::proto::Limits most_, reduced_;  // the second has what a client has given
};

}  // namespace server
