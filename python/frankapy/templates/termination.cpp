#include "$name.pb.h"
#include "server/part.hpp"

namespace {

using namespace realtime;

// Ends the skill when the end effector is lower than a height above the base.
class $Name : public Termination {
 public:
  // In the server room: it may allocate, and throws std::invalid_argument for what the message's rules cannot say.
  $Name(const $name::$Name& message, const Arm&) : height_(message.height()) {}

  // In the 1 kHz loop.
  bool step(const Cycle& cycle, const Progress&) noexcept override { return cycle.O_T_EE.translation().z() < height_; }

 private:
  double height_;  // m, in O
};

}  // namespace

FRANKA_INTERFACE_PARTS(parts) { parts.add<$Name, $name::$Name>(); }
