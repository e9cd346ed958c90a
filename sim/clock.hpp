#pragma once

#include <cstdint>

namespace sim {

// Time, ns from some beginning, and waiting for it.
class Clock {
 public:
  virtual ~Clock() = default;
  virtual std::int64_t now() const = 0;
  // Until then, or a signal.
  virtual void sleep_until(std::int64_t time) = 0;
  // Until there is something to read from a socket, or then, or a signal.
  virtual void wait_for(int socket, std::int64_t time) = 0;
};

// The computer's, which nobody sets.
class WallClock final : public Clock {
 public:
  std::int64_t now() const override;
  void sleep_until(std::int64_t time) override;
  void wait_for(int socket, std::int64_t time) override;
};

}  // namespace sim
