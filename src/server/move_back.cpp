// The one skill that is the server's own (Skills::move_back): what a client's skill has, but nobody that commands it.

#include <algorithm>
#include <exception>
#include <memory>
#include <string>
#include <utility>

#include "frankapy/proto/controllers.pb.h"
#include "frankapy/proto/trajectories.pb.h"
#include "server/publisher.hpp"
#include "server/refused.hpp"
#include "server/skills.hpp"

namespace server {

void Skills::move_back(const realtime::Vector7& q, std::function<void(const std::string&)> done) {
  constexpr double kSpeed = 0.05, kPeak = 1.875;  // rad/s at most; of a minimum-jerk motion's mean speed
  try {
    auto build = std::make_shared<Build>();
    build->connection = arm_.require();
    build->skill_id = next_id();
    build->message.set_description("back inside the joints' range");
    const realtime::Vector7 now = realtime::Vector7::Map(require_state().state.q.data());
    proto::MinJerkJoint motion;
    for (double each : q) motion.add_q(each);
    motion.set_duration(std::max(1., kPeak * (q - now).cwiseAbs().maxCoeff() / kSpeed));
    build->message.mutable_trajectory()->PackFrom(motion);
    build->message.mutable_controller()->PackFrom(proto::InternalImpedance());
    const auto why_not = std::make_shared<std::string>();
    jobs_.put(
        build->from,
        [this, build, why_not] {
          try {
            make(*build);
          } catch (const std::exception& error) {
            *why_not = error.what();
          }
        },
        [this, build, why_not, done] {
          if (!build->skill) return done(*why_not);
          if (!arm_.is(build->connection)) return done("the connection to the robot was lost");
          begin_own(*build, done);
        });
  } catch (const Refused& refused) {
    done(refused.what());
  }
}

void Skills::begin_own(Build& build, std::function<void(const std::string&)> done) {
  auto skill = std::move(build.skill);
  const std::uint64_t id = skill->id = build.skill_id;
  publisher_.describe(id, build.message);
  Running running{build.from, skill->trajectory->goal(), std::move(build.message), skill->mode, skill->settings, false,
                  build.made_at, {}};
  running.done = std::move(done);
  running_.emplace(id, std::move(running));
  if (const auto unread = door_.next.put(std::move(skill))) end({.skill_id = unread->id, .ending = realtime::Ending::kPreempted});
}

}  // namespace server
