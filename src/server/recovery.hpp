#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "frankapy/proto/skill.pb.h"
#include "realtime/door.hpp"
#include "server/config.hpp"
#include "server/connected_arm.hpp"

namespace server {

// Brings the arm back after errors of the robot and user stops, as far as skills, clients and the lab's configuration let it: by
// itself, or when it is asked to. In order: people let go of the arm and release the user stop; the robot recovers; joints outside
// their range are moved back. Where it does not come to its end, who asked is told what stands in the way.
class Recovery {
 public:
  using Answer = std::function<void(const frankapy::proto::Recovery&)>;
  using Outside = std::vector<std::pair<int, double>>;  // joints, 1 to 7, that are outside their range, and how far, rad
  // Moves the arm slowly to these joints, rad; then `done` is told why it is not there, and nothing where it is.
  using MoveBack = std::function<void(const realtime::Vector7& q, std::function<void(const std::string& why_not)> done)>;

  Recovery(realtime::Door& door, const ConnectedArm& arm, const RecoveryConfig& lab, MoveBack move_back);

  // A skill was ended by the robot, in the cycle of `record`. Answered now, or when the arm has recovered by itself or has not.
  void after_error(const realtime::SkillResult& result, const realtime::Record& record,
                   const frankapy::proto::RecoveryPolicy& policy, Answer answer);
  // A skill has ended otherwise.
  void after(realtime::Ending ending);

  // A client asks; `stopped`: before a stop that has overtaken it. Answered now, or when the arm has recovered or has not.
  void ask(const frankapy::proto::Recover& recover, bool stopped, const realtime::Record& now, Answer answer);

  // What has come from the loop.
  void take_results();
  // The loop is gone.
  void abandon(const std::string& why);

  // While it recovers: afterwards nothing moves.
  void stop();

  bool busy() const { return !waiting_.empty() || !until_back_.empty(); }

 private:
  using Who = frankapy::proto::RecoveryPolicy::Who;
  enum class Cause { kError, kCollision, kUserStop };

  struct Waiting {
    Answer answer;
    bool by_itself;
    std::int64_t begin_ns;  // CLOCK_MONOTONIC
  };

  static Cause cause_of(const realtime::Record& record);
  Who lab(Cause cause) const;
  bool too_often(unsigned times) const;
  Who who_may(Cause cause, const frankapy::proto::RecoveryPolicy& policy) const;
  Who who_may(Cause cause) const;
  frankapy::proto::Recovery not_recovered(const realtime::Record& record, Who who) const;
  frankapy::proto::Recovery failed(const realtime::RecoveryResult& result, const realtime::Record& record,
                                   const Outside& outside) const;
  std::optional<models::Limits> limits() const;
  void start(Answer answer, bool by_itself, const realtime::Record& seen, std::int64_t begin_ns);
  void finish(std::vector<Waiting> waiting, frankapy::proto::Recovery out);

  realtime::Door& door_;
  const ConnectedArm& arm_;
  const RecoveryConfig lab_;
  const MoveBack move_back_;
  std::vector<Waiting> waiting_;     // for the loop
  std::vector<Waiting> until_back_;  // for the arm, which is moved back
  std::optional<std::uint64_t> failed_in_;        // record of the skill that failed last
  frankapy::proto::RecoveryPolicy failed_under_;  // what it says, until another ends otherwise
  bool stopped_ = false;   // while it recovered
  unsigned in_a_row_ = 0;  // by itself, without a skill between that has ended by itself
};

}  // namespace server
