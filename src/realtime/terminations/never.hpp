#pragma once

#include "realtime/terminations/termination.hpp"

namespace realtime {

// Ends nothing: the skill goes on until it is stopped or another takes over.
class Never : public Termination {
 public:
  bool step(const Cycle&, const Progress&) noexcept override { return false; }
};

}  // namespace realtime
