#pragma once

#include <cstdint>
#include <optional>
#include <variant>

#include "robot/mode.hpp"
#include "wire/fci/robot_command.hpp"
#include "wire/fci/robot_state.hpp"
#include "wire/fci/service.hpp"

namespace robot {

using Request = std::variant<fci::Move, fci::StopMove, fci::AutomaticErrorRecovery,
                             fci::SetJointImpedance, fci::SetCartesianImpedance,
                             fci::SetCollisionBehavior, fci::SetEEToK, fci::SetNEToEE, fci::SetLoad>;

struct Answer {
  std::uint32_t id = 0;  // what post() returned
  fci::Command command = fci::Command::kConnect;
  fci::Status status = fci::Status::kSuccess;
};

enum class Received {
  kState,    // a newer state than the last one
  kNothing,  // none within the time
  kLost,     // the connection is gone
};

// One connected arm as the loop sees it. All calls come from the loop's thread; none allocates,
// throws or waits, but for receive(), which is the loop's clock.
class Driver {
 public:
  virtual ~Driver() = default;

  // Waits for the next state, at most a second, and keeps the newest if several have come.
  virtual Received receive(fci::RobotState& state) noexcept = 0;

  // When that state was in hand; CLOCK_MONOTONIC, ns.
  virtual std::int64_t received_ns() const noexcept = 0;

  // Sends the command of this cycle; its message_id is that of the state it answers.
  virtual void send(const fci::RobotCommand& command) noexcept = 0;

  // Sends a request; nothing when the connection cannot take it. A Move is answered twice:
  // kMotionStarted (or a refusal), and the end of the motion.
  virtual std::optional<std::uint32_t> post(const Request& request) noexcept = 0;

  // The next answer that has arrived, if any.
  virtual std::optional<Answer> poll() noexcept = 0;

  virtual fci::Version version() const noexcept = 0;
};

}  // namespace robot
