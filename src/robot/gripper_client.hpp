#pragma once

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "robot/socket.hpp"
#include "wire/fci/gripper.hpp"

namespace robot {

// What a client of the hand waits for at most.
struct GripperTimes {
  std::chrono::milliseconds connect{2000};  // and for the hand to take a request
  std::chrono::milliseconds answer{5000};   // beside the time that the fingers need, and after they were last seen to move
  std::chrono::milliseconds homing{30000};  // for the fingers to find their ends
};

// The hand's client (protocol 3, TCP port 1338 and UDP). Calls block until the hand has answered, or has not for longer than it
// can need, and may be made from any thread; stop() and cancel() reach a call that waits in another one, and state() waits for
// none. For the server room.
class GripperClient {
 public:
  enum class Outcome {
    kSuccess,
    kUnsuccessful,  // grasp: the fingers stopped outside the tolerance
    kFailed,        // the hand could not do it
    kAborted,       // stopped, or another command took over
    kCancelled,     // cancel() was called
    kLost,          // the connection is gone; make a new client
    kSilent,        // no answer in time; one that comes later is passed over
  };

  // Throws ConnectError.
  explicit GripperClient(const std::string& address, const GripperTimes& times = {});
  ~GripperClient();

  Outcome homing();
  Outcome move(double width, double speed);  // m, m/s
  Outcome grasp(const fci::gripper::Grasp& request);
  // Stops the fingers; a command that runs ends with kAborted.
  Outcome stop();

  // Makes every call that waits, and every later one, return kCancelled.
  void cancel();

  // The newest state; none when the hand has sent none for a second.
  std::optional<fci::gripper::State> state() const;

  // Why calls return kLost; empty while the connection is there.
  std::string lost() const;

 private:
  struct Call {
    std::uint32_t id;
    std::optional<Outcome> outcome;
  };

  template <class Request>
  Outcome call(const Request& request, std::chrono::duration<double> motion);
  void run();
  bool read_tcp();
  void read_udp();
  void answer(std::uint32_t id, std::uint16_t status);
  void lose(const std::string& why);

  const Peer peer_;
  const GripperTimes times_;
  Socket tcp_, udp_, wake_;

  std::mutex sending_;  // a whole request, which takes bounded time; never waited for with mutex_ locked
  mutable std::mutex mutex_;
  std::condition_variable answered_;
  std::uint32_t next_id_ = 1;  // 0 was Connect
  std::vector<Call*> waiting_;
  std::optional<fci::gripper::State> state_;
  Clock::time_point state_time_, moved_;  // moved_: when the fingers were last seen to move, by more than noise
  double moved_to_ = 0;                   // m, their width then
  bool cancelled_ = false;
  std::string lost_;

  std::vector<std::byte> in_;
  std::thread reader_;
};

}  // namespace robot
