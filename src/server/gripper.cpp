#include "server/gripper.hpp"

#include <spdlog/spdlog.h>

#include "server/refused.hpp"

namespace server {
namespace {

constexpr auto kConnectPeriod = std::chrono::seconds(1);
constexpr std::size_t kMostAtOnce = 8;

using Outcome = robot::GripperClient::Outcome;

Outcome run(robot::GripperClient& client, const proto::GripperCommand& command) {
  switch (command.command_case()) {
    case proto::GripperCommand::kHoming: return client.homing();
    case proto::GripperCommand::kMove: return client.move(command.move().width(), command.move().speed());
    case proto::GripperCommand::kGrasp: {
      const auto& grasp = command.grasp();
      return client.grasp({.width = grasp.width(),
                           .epsilon_inner = grasp.epsilon_inner(),
                           .epsilon_outer = grasp.epsilon_outer(),
                           .speed = grasp.speed(),
                           .force = grasp.force()});
    }
    case proto::GripperCommand::kStop: return client.stop();
    case proto::GripperCommand::COMMAND_NOT_SET: break;
  }
  return Outcome::kFailed;
}

std::string explain(Outcome outcome, const robot::GripperClient& client) {
  switch (outcome) {
    case Outcome::kSuccess: return "";
    case Outcome::kUnsuccessful:
      return "the fingers stopped outside width - epsilon_inner to width + epsilon_outer: nothing of that width is "
             "between them";
    case Outcome::kFailed: return "the hand could not do it: home it, and see that nothing blocks the fingers";
    case Outcome::kAborted: return "stopped, or another gripper command took over";
    case Outcome::kCancelled: return "the server is stopping";
    case Outcome::kLost: return client.lost();
    case Outcome::kSilent: return "the hand gave no answer in time: is it switched on, and does its connection work? Stop it, or home it";
  }
  return "";
}

}  // namespace

Gripper::Gripper(const std::string& address) : address_(address) {
  thread_ = std::thread([this] { keep_connected(); });
}

Gripper::~Gripper() {
  {
    const std::lock_guard lock(mutex_);
    quit_ = true;
    if (client_) client_->cancel();
  }
  changed_.notify_all();
  thread_.join();
}

void Gripper::keep_connected() {
  bool told = false;  // of an absence, once
  std::unique_lock lock(mutex_);
  while (!quit_) {
    if (client_ && !client_->lost().empty()) {
      why_not_ = client_->lost();
      spdlog::warn("hand: {}", why_not_);
      client_ = nullptr;
    }
    if (!client_) {
      lock.unlock();
      std::shared_ptr<robot::GripperClient> client;
      std::string why_not;
      try {
        client = std::make_shared<robot::GripperClient>(address_);
        spdlog::info("hand: connected");
        told = false;
      } catch (const std::exception& error) {  // nobody there, or no room for another thread
        why_not = error.what();
        if (!told) spdlog::info("hand: {}", why_not);
        told = true;
      }
      lock.lock();
      client_ = client;
      why_not_ = why_not;
      attempted_ = true;
      changed_.notify_all();
    }
    changed_.wait_for(lock, kConnectPeriod, [this] { return quit_; });
  }
}

void Gripper::wait_for_first_attempt(std::chrono::milliseconds timeout) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, timeout, [this] { return attempted_; });
}

std::shared_ptr<robot::GripperClient> Gripper::client() const {
  const std::lock_guard lock(mutex_);
  return client_;
}

bool Gripper::connected() const { return client() != nullptr; }

void Gripper::start(const proto::GripperCommand& command, std::uint64_t ticket) {
  std::shared_ptr<robot::GripperClient> client;
  {
    const std::lock_guard lock(mutex_);
    if (!client_) throw Refused(proto::Error::NOT_READY, "no hand: " + why_not_);
    client = client_;
  }
  if (running_.size() >= (command.has_stop() ? 2 : 1) * kMostAtOnce) {  // there is room to stop them
    throw Refused(proto::Error::BUSY,
                  fmt::format("{} gripper commands are under way: wait for them, or stop the gripper", kMostAtOnce));
  }
  running_.push_back(std::async(std::launch::async, [client, command, ticket] {
    const Outcome outcome = run(*client, command);
    Finished finished{ticket, {}};
    finished.result.set_success(outcome == Outcome::kSuccess);
    finished.result.set_message(explain(outcome, *client));
    return finished;
  }));
}

std::optional<Gripper::Finished> Gripper::poll() {
  for (auto it = running_.begin(); it != running_.end(); ++it) {
    if (it->wait_for(std::chrono::seconds(0)) != std::future_status::ready) continue;
    Finished finished = it->get();
    running_.erase(it);
    return finished;
  }
  return std::nullopt;
}

void Gripper::put_state(proto::ArmState& state) const {
  const auto client = this->client();
  const auto hand = client ? client->state() : std::nullopt;
  if (!hand) return;
  auto& out = *state.mutable_gripper();
  out.set_width(hand->width);
  out.set_max_width(hand->max_width);
  out.set_is_grasped(hand->is_grasped);
  out.set_temperature(hand->temperature);
}

}  // namespace server
