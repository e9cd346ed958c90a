#include "server/self_collision.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "realtime/walls/self_distance.hpp"
#include "server/refused.hpp"
#include "server/wall_store.hpp"

namespace server {
namespace {

using realtime::ArmCapsules;

constexpr double kNearing = 1e-4;  // m that is no nearer

}  // namespace

void check_self_collision(const ArmCapsules& arm, std::span<const realtime::Vector7> way, const std::string& what) {
  if (way.empty()) return;
  double distance = realtime::self_distance(arm, way[0]).distance;
  double moved = 0;  // at most, m, since distance was found
  for (std::size_t k = 1; k < way.size(); ++k) {
    moved += arm.reach() * (way[k] - way[k - 1]).lpNorm<1>();
    if (moved < distance - realtime::kSelfClearance) continue;
    distance = realtime::self_distance(arm, way[k]).distance;
    moved = 0;
    const auto found = realtime::comes_nearer(arm, way[0], way[k], realtime::kSelfClearance, kNearing);
    if (!found) continue;
    const bool goal = k + 1 == way.size();
    refuse(fmt::format("{}: {} would come within {:.0f} mm of {} of the arm itself {}: motions keep {:.0f} mm, as the "
                       "robot stops at {:.0f} mm from its own links. Choose another {}",
                       what, name_of_link(found->links[1]), 1e3 * std::max(found->distance, 0.), name_of_link(found->links[0]),
                       goal ? "at its goal" : fmt::format("at {:.0f} % of its way", 100. * k / (way.size() - 1)),
                       1e3 * realtime::kSelfClearance, 1e3 * models::kCapsuleMargin, goal ? "goal" : "way, such as by a posture between"));
  }
}

}  // namespace server
