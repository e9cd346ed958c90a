#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "frankapy/proto/service.pb.h"
#include "realtime/door.hpp"
#include "server/limit_store.hpp"
#include "server/skill_builder.hpp"
#include "server/wall_store.hpp"

namespace server {

// The arm as requests find it: whether it is connected, with what builder, walls and limits. It hands walls and limits to the loop
// at the door. One thread serves requests, another connects.
class ConnectedArm {
 public:
  // The walls as a builder gets them.
  struct WallsForBuilder {
    realtime::Walls walls;
    WallStore names;
  };
  struct Connection {
    std::shared_ptr<SkillBuilder> builder;  // null: not connected; the workbench's to use
    std::shared_ptr<const WallsForBuilder> walls;
    models::Limits limits{};  // of what may be asked for
    frankapy::proto::Welcome welcome;
    std::string why_not = "the robot is being connected";
  };

  ConnectedArm(realtime::Door& door, WallStore walls, LimitStore limits, bool hand);
  ~ConnectedArm();

  // From the thread that connects: see Transport.
  void connected(std::shared_ptr<SkillBuilder> builder, const frankapy::proto::Welcome& welcome);
  void disconnected(const std::string& why);

  // Throws Refused where there is none.
  Connection require() const;
  // Whether that is still the one.
  bool is(const Connection& connection) const;
  // Why, where it was lost and settle() has not been called since.
  std::optional<std::string> lost() const;
  // Nothing is left of what was connected.
  void settle();

  // What is to be done before this change of walls, where some are to be kept otherwise than now: as WallStore::kept_after(). For
  // any thread.
  std::function<void()> keeping(const frankapy::proto::ChangeWalls& change, const Keys::Client& who) const;
  // As WallStore and LimitStore; what comes of it is handed on.
  void change(const frankapy::proto::ChangeWalls& change, const Keys::Client& who);
  void change(const frankapy::proto::ChangeLimits& change);
  frankapy::proto::Walls walls() const;
  // Those that an arm at `q` (rad) is nearer to than motions keep.
  void tell_nearer(const realtime::Vector7& q, frankapy::proto::Walls& out) const;
  frankapy::proto::LimitsInForce limits() const;
  std::string wall_name(std::uint32_t id) const { return walls_.name(id); }

  // What the loop no longer needs.
  void take_back();

 private:
  void hand_on_walls();
  void hand_on_limits();

  realtime::Door& door_;
  const bool hand_;
  mutable std::mutex mutex_;
  Connection connection_;
  WallStore walls_;
  LimitStore limits_;
  bool disconnected_ = false;  // and not dealt with yet
  std::condition_variable settled_;
};

}  // namespace server
