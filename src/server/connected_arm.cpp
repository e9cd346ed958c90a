#include "server/connected_arm.hpp"

#include <chrono>
#include <utility>

#include "models/arm.hpp"
#include "server/kept.hpp"
#include "server/refused.hpp"

namespace server {

ConnectedArm::ConnectedArm(realtime::Door& door, WallStore walls, LimitStore limits, bool hand)
    : door_(door), hand_(hand), walls_(std::move(walls)), limits_(std::move(limits)) {}

ConnectedArm::~ConnectedArm() { take_back(); }

void ConnectedArm::connected(std::shared_ptr<SkillBuilder> builder, const proto::Welcome& welcome) {
  std::unique_lock lock(mutex_);
  settled_.wait_for(lock, std::chrono::seconds(1), [this] { return !disconnected_; });
  limits_.connect(builder->limits_of_loop());
  connection_ = {std::move(builder), nullptr, {}, welcome, ""};
  hand_on_walls();
  hand_on_limits();
}

void ConnectedArm::disconnected(const std::string& why) {
  const std::lock_guard lock(mutex_);
  disconnected_ = disconnected_ || connection_.builder != nullptr;
  connection_.builder = nullptr;
  connection_.why_not = why;
}

ConnectedArm::Connection ConnectedArm::require() const {
  Connection connection;
  {
    const std::lock_guard lock(mutex_);
    connection = connection_;
  }
  if (!connection.builder) throw Refused(proto::Error::NOT_READY, connection.why_not);
  return connection;
}

bool ConnectedArm::is(const Connection& connection) const {
  const std::lock_guard lock(mutex_);
  return connection_.builder == connection.builder;
}

std::optional<std::string> ConnectedArm::lost() const {
  const std::lock_guard lock(mutex_);
  return disconnected_ ? std::optional(connection_.why_not) : std::nullopt;
}

void ConnectedArm::settle() {
  {
    const std::lock_guard lock(mutex_);
    disconnected_ = false;
  }
  settled_.notify_all();
}

void ConnectedArm::change(const proto::ChangeWalls& change, const Keys::Client& who) {
  const std::lock_guard lock(mutex_);
  walls_.change(change, who);
  hand_on_walls();
}

std::function<void()> ConnectedArm::keeping(const proto::ChangeWalls& change, const Keys::Client& who) const {
  const std::lock_guard lock(mutex_);
  const auto keep = walls_.kept_after(change, who);
  if (!keep) return nullptr;
  return [file = walls_.file(), keep = *keep] { save(file, keep); };
}

void ConnectedArm::change(const proto::ChangeLimits& change) {
  const std::lock_guard lock(mutex_);
  limits_.change(change);
  hand_on_limits();
}

proto::Walls ConnectedArm::walls() const {
  const std::lock_guard lock(mutex_);
  return walls_.list();
}

void ConnectedArm::tell_nearer(const realtime::Vector7& q, proto::Walls& out) const {
  const std::lock_guard lock(mutex_);
  if (connection_.builder) server::tell_nearer(connection_.walls->walls, connection_.walls->names, q, out);
}

proto::LimitsInForce ConnectedArm::limits() const {
  const std::lock_guard lock(mutex_);
  return limits_.list();
}

// To the loop and to the builder, where there are any. With mutex_ locked.
void ConnectedArm::hand_on_walls() {
  if (connection_.builder == nullptr) return;
  auto walls = walls_.make(models::arm(connection_.welcome.model()), hand_);
  connection_.walls = std::make_shared<const WallsForBuilder>(WallsForBuilder{*walls, walls_});
  door_.walls.put(std::move(walls));
}

// As hand_on_walls().
void ConnectedArm::hand_on_limits() {
  if (connection_.builder == nullptr) return;
  const realtime::Bounds bounds = limits_.make();
  connection_.limits = bounds.limits;
  door_.bounds.put(std::make_unique<realtime::Bounds>(bounds));
}

void ConnectedArm::take_back() {
  while (realtime::Walls* const* former = door_.former_walls.front()) {
    delete *former;
    door_.former_walls.pop();
  }
  while (realtime::Bounds* const* taken = door_.taken_bounds.front()) {
    delete *taken;
    door_.taken_bounds.pop();
  }
}

}  // namespace server
