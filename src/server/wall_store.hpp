#pragma once

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "frankapy/proto/walls.pb.h"
#include "models/arm.hpp"
#include "realtime/walls/wall_guard.hpp"
#include "server/keys.hpp"

namespace server {

// Those that are to be kept while no server runs; none where there is no such file. Throws std::runtime_error where it cannot be
// read: an arm must not move without what was to protect it.
frankapy::proto::Walls kept_walls(const std::string& file);

// The walls of an arm by name, of its configuration and of clients. Those that are protected (Wall.fixed), as those of the
// configuration are, only role lab changes. It makes of them what the loop has.
class WallStore {
 public:
  // Those of the configuration, and what clients have changed in a file that outlives this process (-1: none), which is kept as
  // it is; of their walls, those that are to be kept also in one that outlives the server (empty: none). Throws Refused as
  // change(), and as kept_walls().
  explicit WallStore(const std::vector<frankapy::proto::Wall>& fixed, int fd = -1, std::string file = {});

  // What file() has to hold before this change is made, where that is something else: whoever makes it saves that first, which
  // takes as long as a disk takes. Throws as change().
  std::optional<frankapy::proto::Walls> kept_after(const frankapy::proto::ChangeWalls& change, const Keys::Client& who) const;
  const std::string& file() const { return file_; }

  // Throws Refused: a wall that is none or that is protected from `who`, one to remove that is not there, more than the loop
  // can look at in a cycle. Nothing is changed then.
  void change(const frankapy::proto::ChangeWalls& change, const Keys::Client& who = {"", "", frankapy::proto::USER});

  frankapy::proto::Walls list() const;

  // For an arm, with or without a hand.
  std::unique_ptr<realtime::Walls> make(const models::Arm& arm, bool hand) const;

  // Of realtime::Wall::id; empty for 0 or one that is no more.
  std::string name(std::uint32_t id) const;

 private:
  struct Entry {
    std::uint32_t id;
    frankapy::proto::Wall wall;
    bool configured = false;  // as it is in the configuration
  };
  static void put(frankapy::proto::Wall wall, std::map<std::string, Entry>& into, std::uint32_t id);
  static void check_numbers(const std::map<std::string, Entry>& entries);

  void take_again(const frankapy::proto::Wall& wall);
  void apply(const frankapy::proto::ChangeWalls& change, const Keys::Client& who);
  frankapy::proto::Walls to_keep() const;
  frankapy::proto::ChangeWalls changes() const;

  int fd_;
  std::string file_;
  std::map<std::string, Entry> entries_;
  std::uint32_t last_id_ = 0;
  std::set<std::string> configured_;  // names
};

// A link of the arm (ArmCapsules), for people.
std::string name_of_link(int link);

// Adds the walls that an arm at `q` (rad) is nearer to than motions keep, by whichever of its links is nearest.
void tell_nearer(const realtime::Walls& walls, const WallStore& names, const realtime::Vector7& q, frankapy::proto::Walls& out);

// Checks the way of a motion, postures (rad) in order of which the first is where the arm is: none may bring it nearer to a wall
// than the loop lets it come, or nearer than it is. Throws Refused that says what would touch which wall, and where.
// `what`: the kind of the motion.
void check_walls(const realtime::Walls& walls, const WallStore& names, std::span<const realtime::Vector7> way,
                 const std::string& what);

}  // namespace server
