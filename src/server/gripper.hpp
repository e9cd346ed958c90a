#pragma once

#include <condition_variable>
#include <cstdint>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "frankapy/proto/service.pb.h"
#include "robot/gripper_client.hpp"

namespace server {

// The hand of an arm, or its absence. Connects by itself, again and again where there is none.
class Gripper {
 public:
  explicit Gripper(const std::string& address);
  ~Gripper();

  // Waits until the first attempt to connect is over, at most `timeout`.
  void wait_for_first_attempt(std::chrono::milliseconds timeout);

  bool connected() const;

  // Begins a command; a later one takes over from it, as in the hand. Throws Refused: no hand (with the
  // reason), or too many at once.
  void start(const frankapy::proto::GripperCommand& command, std::uint64_t ticket);

  struct Finished {
    std::uint64_t ticket;
    frankapy::proto::GripperResult result;
  };
  // The next command that has ended.
  std::optional<Finished> poll();

  void put_state(frankapy::proto::ArmState& state) const;

 private:
  void keep_connected();
  std::shared_ptr<robot::GripperClient> client() const;

  const std::string address_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::shared_ptr<robot::GripperClient> client_;
  std::string why_not_ = "the hand is being connected";
  bool attempted_ = false, quit_ = false;
  std::vector<std::future<Finished>> running_;  // the transport's thread alone
  std::thread thread_;
};

}  // namespace server
