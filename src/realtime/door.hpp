#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <utility>

#include "bridge/queue.hpp"
#include "bridge/ring.hpp"
#include "bridge/slot.hpp"
#include "realtime/bounds.hpp"
#include "realtime/skill.hpp"
#include "realtime/walls/wall_guard.hpp"
#include "wire/fci/robot_command.hpp"

namespace realtime {

// Where the loop is. In kRunning, kHolding and kBraking a motion of the robot is active.
enum class Phase : std::uint8_t {
  kConnecting,   // no states yet, or no longer
  kIdle,         // the robot holds itself
  kConfiguring,  // settings are being sent
  kStarting,     // Move is sent, the robot's modes do not match yet
  kRunning,      // a skill
  kHolding,      // no skill; the reference is kept
  kBraking,      // to rest, before another robot controller or the end of the motion
  kFinishing,    // the finish flag is sent until the robot is idle
  kError,        // reflex, user stop or another mode in which the robot takes no motion
  kRecovering,   // automatic error recovery is asked for
};

// One cycle as the rest of the server sees it: published, recorded, and the base of every read.
struct Record {
  fci::RobotState state;
  fci::RobotCommand command;  // as sent; message_id 0 when none was sent
  Phase phase = Phase::kConnecting;
  std::uint64_t skill_id = 0;  // 0: none
  double skill_time = 0;       // s
  Reference reference;         // after the limits
  HeldBy held_by = HeldBy::kNothing;  // in this cycle
  // By the momentum observer, N m; N and N m at K, axes of O.
  Vector7 tau_ext = Vector7::Zero();
  Vector6 O_F_ext_K = Vector6::Zero();
  bool collision = false;
  std::uint64_t cycles = 0;    // since the loop began
  std::uint64_t lost_states = 0;  // states that did not arrive, by message_id
  std::int64_t received_ns = 0;   // CLOCK_MONOTONIC when the state was in hand
  std::int64_t compute_ns = 0;    // state in hand to command ready, the network left out; 0 when none was sent
};

// What came of a request for recovery.
struct RecoveryResult {
  bool recovered = false;  // or there was nothing to recover from
  bool accepted = false;   // the robot took it; if not recovered, it was not idle in time
  bool unseen = false;     // it was not asked: the error came after what whoever asks had seen
  fci::Status status = fci::Status::kSuccess;            // the robot's answer; kFailed: it gave none in time
  fci::RobotMode robot_mode = fci::RobotMode::kOther;    // afterwards
  std::optional<std::uint64_t> record = {};  // number in Door::records of the cycle that knows it; none of a lost connection
};

// Everything that passes between the two rooms. The server room writes the first half, the loop the
// second.
struct Door {
  static constexpr std::size_t kRecords = 4096;

  explicit Door(bridge::Ring<Record> for_records = bridge::Ring<Record>(kRecords)) : records(std::move(for_records)) {}

  bridge::Slot<Skill> next;  // takes over at once; the newest wins. Ids grow from 1
  bridge::Slot<Skill> queued;  // waits for the one before, see Skill::after; put where it is empty
  bridge::Slot<Change> change;  // of the running skill; put where it is empty, and after the last one is back in `changed`
  bridge::Slot<Walls> walls;    // take the place of those before
  bridge::Slot<Bounds> bounds;  // likewise
  std::atomic<std::uint64_t> stop_up_to{0};  // skills with this id or a smaller one brake and end; then the
                                             // loop holds. Of one that is not yet taken nothing is run
  // The cycle that whoever asks the robot for automatic error recovery has seen; 0: nobody does. Answered in `recoveries`: from an
  // error that came later nobody has asked to recover.
  std::atomic<std::uint64_t> recover{0};
  std::atomic<bool> quit{false};     // brake, finish, return

  std::atomic<std::uint64_t> robot_time{0};  // message_id of the newest state, ms
  // One for each skill that went through `next`, as soon as it has ended.
  bridge::Queue<SkillResult> results{64};
  // The skills themselves, to be destroyed by the receiver: later than their results, since the controller of
  // the last one keeps holding the arm.
  bridge::Queue<Skill*> retired{64};
  bridge::Queue<Change*> changed{4};  // to be destroyed by the receiver
  bridge::Queue<Walls*> former_walls{4};  // to be destroyed by the receiver
  bridge::Queue<Bounds*> taken_bounds{4};  // likewise
  bridge::Queue<RecoveryResult> recoveries{16};
  bridge::Ring<Record> records;
};

}  // namespace realtime
